"""Checkpoints: the state of a training between two iterations, with which it goes on."""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.start import unit_hyperparams
from mdpo_rddl.planner.training.found import Found
from mdpo_rddl.planner.training.loop_state import LoopState, WatchedLoop

LEAST_SECONDS = 1e-6
"""What is left of a time that is used up: one call."""

_LOOP, _FOUND = "loop/", "found/"


@dataclass(frozen=True)
class TrainingState:
    """All that a training needs to go on.

    Attributes:
      tensors: by their names.
      numbers: the iterations done, the seconds used, the sizes of a call and the stopping rule's
        numbers, as JSON can hold them.
    """

    tensors: dict[str, np.ndarray]
    numbers: Mapping[str, Any]

    @property
    def iterations(self) -> int:
        """Iterations done."""
        return int(self.numbers["iterations"])

    @property
    def seconds(self) -> float:
        """Seconds of training used."""
        return float(self.numbers["seconds"])

    def require_numbers(self, most_iterations: int, longest_call: tuple[int, int]) -> None:
        """Raises an error unless a training can have left these numbers.

        Args:
          most_iterations: of its budget.
          longest_call: the planner's iterations of a call, and from one test to the next.

        Raises:
          KeyError, ValueError: if one is missing, or none of such a training.
        """
        iterations, seconds, call, rule = (
            self.numbers[name] for name in ("iterations", "seconds", "call", "rule")
        )
        if not _is_count(iterations, most_iterations - 1):
            raise ValueError(f"its iterations are {_shown(iterations)} of {most_iterations}")
        if not _is_real(seconds) or not 0.0 <= seconds < math.inf:
            raise ValueError(f"its seconds are {_shown(seconds)}")
        is_pair = isinstance(call, list | tuple) and len(call) == 2
        if not is_pair or not all(map(_is_count, call, longest_call)) or call[0] % call[1]:
            raise ValueError(f"its call is {_shown(call)}, of at most {list(longest_call)}")
        if not isinstance(rule, Mapping) or not all(map(_is_real, rule.values())):
            raise ValueError(f"its rule is {_shown(rule)}")


@dataclass(frozen=True)
class Checkpoints:
    """Where a training leaves its state, and with which one it begins.

    Attributes:
      seconds: from one to the next.
      save: is given the state now and then, and when the training is interrupted.
      resumed: what an earlier training has left.
    """

    seconds: float
    save: Callable[[TrainingState], None]
    resumed: TrainingState | None = None


class PlainLoop:
    """The callbacks of a training without checkpoints."""

    def __init__(self, built: Built[MDPOPlanner]) -> None:
        """Has found nothing yet."""
        self.found = Found(built.planner.in_calls)
        self.callbacks = built.callbacks

    def passed(self, callback: Mapping[str, Any]) -> None:
        """Keeps nothing."""

    def save(self) -> None:
        """Keeps nothing."""


class CheckpointedLoop:
    """The callbacks of a training that leaves checkpoints, or goes on from one."""

    def __init__(self, built: Built[MDPOPlanner], checkpoints: Checkpoints) -> None:
        """Restores the state of an earlier training.

        Raises:
          KeyError, ValueError, TypeError: if it does not fit the planner.
        """
        self._built, self._checkpoints = built, checkpoints
        state, planner = checkpoints.resumed, built.planner
        self.found = Found(planner.in_calls)
        self._before, self._seconds = 0, 0.0
        loop = None
        if state is not None:
            self._before, self._seconds = state.iterations, state.seconds
            loop = LoopState(_part(state.tensors, _LOOP), state.numbers["rule"])
            structure = planner.params_structure(unit_hyperparams(planner))
            found = _part(state.tensors, _FOUND)
            shape = planner.restarts, planner.horizon
            self.found = Found.resumed(planner.in_calls, found, structure, shape)
        self._loop = WatchedLoop(planner, built.arguments.get("stopping_rule"), loop)
        self._latest: Callable[[], TrainingState] | None = None
        self._saved_at = self._began = time.monotonic()

    def callbacks(self, key: Any, budget: Budget) -> Iterator[dict[str, Any]]:
        """The callbacks; each has the iteration and what is left of the budget put right."""
        state = self._checkpoints.resumed
        built = self._built.with_arguments(**self._loop.arguments())
        if state is not None:
            key = self._loop.key
            # killed in the evaluation: JaxPlan's loop divides by the seconds
            left = max(budget.seconds - self._seconds, LEAST_SECONDS)
            self._loop.progress = self._progress(budget)
            budget = replace(budget, iterations=budget.iterations - self._before, seconds=left)
        self._saved_at = self._began = time.monotonic()
        for callback in self._loop.turns(lambda: built.callbacks(key, budget)):
            if not self._built.planner.in_calls:  # calls count on by themselves
                callback["iteration"] += self._before
            yield callback

    def _progress(self, budget: Budget) -> Callable[[int], float]:
        """Percent of the whole budget after so many of this loop's iterations, as JaxPlan's."""

        def percent(iterations: int) -> float:
            latest = self._before + iterations - 1
            seconds = self._seconds + time.monotonic() - self._began
            of_iterations = latest / (budget.iterations - 1)
            return 100 * min(1, max(0, seconds / budget.seconds, of_iterations))

        return percent

    def passed(self, callback: Mapping[str, Any]) -> None:
        """An iteration is done, and `found` knows of it."""
        if callback["status"].is_terminal():
            self.save()  # the evaluation may be interrupted too; the last call is done again then
            return
        loop, found = self._loop.state(callback), self.found.snapshot()
        now = time.monotonic()
        numbers = {
            "iterations": callback["iteration"] + 1,
            "seconds": self._seconds + now - self._began,
            "call": [self._built.planner.iterations_per_call, self._built.planner.test_every],
        }

        def make() -> TrainingState:
            state = loop()
            tensors = {_LOOP + name: value for name, value in state.tensors.items()}
            tensors |= {_FOUND + name: value for name, value in found.tensors().items()}
            return TrainingState(tensors, {**numbers, "rule": dict(state.rule)})

        self._latest = make
        if now - self._saved_at >= self._checkpoints.seconds:
            self.save()

    def save(self) -> None:
        """Leaves a checkpoint of the last iteration, unless it was the last one of all."""
        if self._latest is not None:
            self._checkpoints.save(self._latest())
            # an interrupt in between leaves it to be saved
            self._latest = None
        self._saved_at = time.monotonic()


def _part(tensors: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    return {
        name.removeprefix(prefix): value
        for name, value in tensors.items()
        if name.startswith(prefix)
    }


def _is_count(value: Any, most: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= most


def _is_real(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _shown(value: Any) -> str:
    return f"{value!r:.40}"
