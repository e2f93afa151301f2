"""The planner that draws legal actions."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.random_actions import RandomActions


class RandomPlayer:
    """Draws each action anew at every step, as `RandomActions` does."""

    def prepare(self, problem: Problem, seconds: float, seed: int) -> None:
        """Reads the boxes and the limits on groups."""
        self._actions = RandomActions(problem)

    def act(
        self, step: int, state: Mapping[str, Any], rng: np.random.Generator
    ) -> Mapping[str, Any]:
        """A legal draw."""
        return self._actions.draw(state, rng)
