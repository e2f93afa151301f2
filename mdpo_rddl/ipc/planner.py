"""What a planner must be able to do to take part in a run."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from mdpo_rddl.problem.load import Problem


class Planner(Protocol):
    """A planner for one instance: it prepares once and then acts, trial after trial.

    The class takes no arguments. Whatever it raises is recorded as a failure of the instance.
    """

    def prepare(self, problem: Problem, seconds: float, seed: int) -> None:
        """Gets ready for the instance.

        Args:
          problem: the parsed problem; `mdpo_rddl.make_environment` makes simulators of it.
          seconds: what is left of the preparation time; the process is ended after it.
          seed: of the run.
        """

    def act(
        self, step: int, state: Mapping[str, Any], rng: np.random.Generator
    ) -> Mapping[str, Any]:
        """Chooses the actions of one step.

        Args:
          step: counted from 0, which begins a new trial.
          state: per fluent, the observed tensor, as a vectorized environment shows it.
          rng: random numbers of this trial; they depend on the run's seed and the trial alone.

        Returns:
          Per action fluent, its tensor; a fluent that is missing keeps its default.
        """


@runtime_checkable
class Restorable(Planner, Protocol):
    """A planner whose preparation can be kept.

    A run that was stopped goes on with what it had prepared. Planners without these two prepare
    anew then and play all their trials again, since all are to be of one preparation.
    """

    def save(self, folder: Path) -> None:
        """Writes what `prepare` has found into an empty folder."""

    def restore(self, problem: Problem, folder: Path) -> None:
        """Takes the place of `prepare`, from what `save` has written."""


@runtime_checkable
class Improving(Planner, Protocol):
    """A planner that uses the rest of its time when its preparation is kept already.

    Where that takes too long or fails, the trials are played with what was kept.
    """

    def improve(self, seconds: float) -> None:
        """Follows `prepare` or `restore`.

        Args:
          seconds: what is left of the preparation time; the process is ended after it.
        """


@runtime_checkable
class Timed(Planner, Protocol):
    """A planner that uses what time there is for a trial."""

    def play_within(self, seconds: float) -> None:
        """Is told before `prepare` or `restore` how long a trial may take, the environment's part
        included."""
