"""How many iterations a second something makes, measured in turn with something else."""

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax

from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.upstream import JaxBackpropPlanner

ITERATIONS_PER_CALL = 50
_MANY = 10**8


def in_turn(sides: Sequence[Iterator[float]], turns: int) -> list[float]:
    """Medians of the rates that all sides show in turn.

    Args:
      sides: each gives its rate again whenever it is asked.
      turns: how often each is asked.
    """
    shown: list[list[float]] = [[] for _ in sides]
    for _ in range(turns):
        for found, side in zip(shown, sides, strict=True):
            found.append(next(side))
    return [statistics.median(found) for found in shown]


def rates(built: Built[JaxBackpropPlanner], seeds: int, seconds: float) -> Iterator[float]:
    """Seed-iterations a second, over about `seconds` at each turn of the generator."""
    callbacks = built.callbacks(jax.random.PRNGKey(0), Budget(_MANY, 1e300))
    for _ in range(3):  # compiles
        callback = next(callbacks)
    while True:
        before, started = callback["iteration"], time.perf_counter()
        while time.perf_counter() - started < seconds:
            callback = next(callbacks)
        passed = time.perf_counter() - started
        yield seeds * (callback["iteration"] - before) / passed


def rates_of_calls(
    call: Callable[[int], Any], seeds: int, seconds: float, iterations: int = ITERATIONS_PER_CALL
) -> Iterator[float]:
    """The same for a compiled function of a number of iterations, which each call makes."""
    jax.block_until_ready(call(iterations))  # compiles
    while True:
        done, started = 0, time.perf_counter()
        while time.perf_counter() - started < seconds:
            jax.block_until_ready(call(iterations))
            done += iterations
        yield seeds * done / (time.perf_counter() - started)
