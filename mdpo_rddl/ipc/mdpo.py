"""Our planner."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np

from mdpo_rddl.ipc.gradient import GradientPlanner
from mdpo_rddl.ipc.legal_moves import LegalMoves
from mdpo_rddl.jaxplan.config import PlannerConfig
from mdpo_rddl.planning import build_planner
from mdpo_rddl.presets.shipped import config_for_domain
from mdpo_rddl.problem import Problem
from mdpo_rddl.training import train

_MANY = 10_000_000


class MDPO(GradientPlanner):
    """Trains a policy with noise on its actions, and plays a legal action near the policy's."""

    def prepare(self, problem: Problem, seconds: float, seed: int) -> None:
        """Trains for the time given, less a margin."""
        super().prepare(problem, seconds, seed)
        self._moves = LegalMoves(problem)

    def restore(self, problem: Problem, folder: Path) -> None:
        """Reads the policy and compiles it."""
        super().restore(problem, folder)
        self._moves = LegalMoves(problem)

    def act(
        self, step: int, state: Mapping[str, Any], rng: np.random.Generator
    ) -> Mapping[str, Any]:
        """What the policy does if it is legal; it draws nothing."""
        return self._moves.rule(super().act(step, state, rng), state).actions

    def _config(self, problem: Problem) -> PlannerConfig:
        return config_for_domain(str(problem.domain_path), problem.domain_name, "drp")

    def _build(self, problem: Problem, config: PlannerConfig) -> tuple[Any, dict[str, Any]]:
        return build_planner(problem, config)

    def _train(
        self, planner: Any, arguments: dict[str, Any], seed: int, seconds: float
    ) -> tuple[Any, dict[str, Any]]:
        for name in ("key", "epochs", "train_seconds"):
            arguments.pop(name, None)
        result = train(
            planner,
            key=jax.random.PRNGKey(seed),
            iterations=_MANY,
            seconds=seconds,
            counts_compilation=True,
            optimize_kwargs=arguments,
        )
        return result.best_params, dict(result.policy_hyperparams)
