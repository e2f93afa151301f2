"""The methods that differentiate the model: ours in calls of many iterations, and JaxPlan's."""

import collections
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from mdpo_rddl.bench.paper.iterates import Iterate, timed
from mdpo_rddl.bench.paper.names import JAXPLAN
from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.baseline import build_baseline
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.budgets import A_DAY
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.problem.load import Problem


class DivergedError(InputError):
    """No seed's return is a number any more."""


def train_by_gradient(
    problem: Problem,
    method: str,
    config: PlannerConfig,
    key: Any,
    iterations: Sequence[int],
    planner_class: type[MDPOPlanner] = MDPOPlanner,
) -> Iterator[Iterate]:
    """Trains all seeds side by side.

    Args:
      problem: the setting.
      method: its name; `JAXPLAN` is JaxPlan's own planner and loop.
      config: its configuration; the seeds are its parallel updates.
      key: JAX random key; a seed's own keys are split off it, as many as there may be.
      iterations: which iterates are wanted, in order.
      planner_class: ours, for every other method.

    Raises:
      DivergedError: if every seed's return stops being a number.
    """
    if method == JAXPLAN:
        planner, optimize_args = build_baseline(problem, config)
        train = _train_jaxplan
    else:
        planner, optimize_args = build_planner(problem, config, planner_class=planner_class)
        train = _train_ours
    arguments = {
        **optimize_args,
        "key": key,
        "epochs": max(2, iterations[-1]),  # JaxPlan cannot do with one
        "train_seconds": A_DAY,
        "print_summary": False,
        "print_progress": False,
        "print_hyperparams": False,
    }
    for _ in train(planner, arguments, [1, 2]):
        pass  # compiles
    yield from train(planner, arguments, iterations)


def _train_ours(
    planner: MDPOPlanner, arguments: Mapping[str, Any], iterations: Sequence[int]
) -> Iterator[Iterate]:
    sizes = planner.iterations_per_call, planner.test_every
    generator = planner.optimize_generator(**arguments)

    def callbacks(done: int, until: int) -> Iterator[Mapping[str, Any]]:
        # the loop counts its turns when it begins: those of one iteration are enough for any
        for count in (1, until - 1) if done == 0 else (until - done,):
            planner.iterations_per_call = planner.test_every = max(1, count)
            yield from itertools.islice(generator, min(1, count))

    try:
        yield from timed(_advance(callbacks, planner.is_noisy), iterations)
    finally:
        planner.iterations_per_call, planner.test_every = sizes


def _train_jaxplan(
    planner: Any, arguments: Mapping[str, Any], iterations: Sequence[int]
) -> Iterator[Iterate]:
    generator = planner.optimize_generator(**arguments)

    def callbacks(done: int, until: int) -> Iterator[Mapping[str, Any]]:
        return itertools.islice(generator, until - done)

    return timed(_advance(callbacks, has_noise=False), iterations)


def _advance(
    callbacks: Callable[[int, int], Iterator[Mapping[str, Any]]], has_noise: bool
) -> Callable[[int], tuple[Any, Any]]:
    done = 0

    def advance(until: int) -> tuple[Any, Any]:
        nonlocal done
        last = collections.deque(callbacks(done, until), maxlen=1)
        if not last or last[0]["iteration"] + 1 != until:
            raise DivergedError(f"training ended before iteration {until}: every seed diverged")
        callback, done = last[0], until
        return callback["params"], callback["sigma"] if has_noise else None

    return advance
