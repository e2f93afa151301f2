"""The methods that differentiate the model: ours in calls of many iterations, and JaxPlan's."""

import collections
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from benchmarks.paper.iterates import Iterate, timed
from benchmarks.paper.names import JAXPLAN
from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_baseline, build_planner
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import A_DAY, Budget
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.upstream import JaxBackpropPlanner
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
        train = partial(_train_jaxplan, build_baseline(problem, config))
    else:
        built = build_planner(problem, config, planner_class=planner_class)
        train = partial(_train_ours, built)
    budget = Budget(max(2, iterations[-1]), A_DAY)  # JaxPlan cannot do with one
    for _ in train(key, budget, [1, 2]):
        pass  # compiles
    yield from train(key, budget, iterations)


def _train_ours(
    built: Built[MDPOPlanner], key: Any, budget: Budget, iterations: Sequence[int]
) -> Iterator[Iterate]:
    planner, generator = built.planner, built.callbacks(key, budget)

    def callbacks(done: int, until: int) -> Iterator[Mapping[str, Any]]:
        # the loop counts its turns when it begins: those of one iteration are enough for any
        for count in (1, until - 1) if done == 0 else (until - done,):
            with planner.call_sizes(max(1, count), max(1, count)):
                yield from itertools.islice(generator, min(1, count))

    return timed(_advance(callbacks, planner.is_noisy), iterations)


def _train_jaxplan(
    built: Built[JaxBackpropPlanner], key: Any, budget: Budget, iterations: Sequence[int]
) -> Iterator[Iterate]:
    generator = built.callbacks(key, budget)

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
