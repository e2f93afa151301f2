"""The planner that does nothing."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mdpo_rddl.problem.load import Problem


class NoopPlayer:
    """Leaves every action fluent at its default."""

    def prepare(self, problem: Problem, seconds: float, seed: int) -> None:
        """Needs nothing."""

    def act(
        self, step: int, state: Mapping[str, Any], rng: np.random.Generator
    ) -> Mapping[str, Any]:
        """No fluent, hence all defaults."""
        return {}
