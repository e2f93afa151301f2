"""Our planner."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mdpo_rddl.auto import plan_automatically
from mdpo_rddl.ipc.gradient import Found, GradientPlanner
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import DEFAULT_PRESET, PRESETS
from mdpo_rddl.problem.legal_moves import LegalMoves
from mdpo_rddl.problem.load import Problem


class MDPO(GradientPlanner):
    """Trains a policy by the default preset, and plays a legal action near the policy's."""

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

    def _find(self, problem: Problem, seconds: float, seed: int) -> Found:
        config = PRESETS[DEFAULT_PRESET](problem.domain_name)
        config = config.with_values("Optimize", train_seconds=seconds)
        policy = plan_automatically(problem, config, seed).policy
        hyperparams = dict(policy.policy_hyperparams)
        return Found(policy.planner, policy.config, policy.params, hyperparams)

    def _build(self, problem: Problem, config: PlannerConfig) -> Any:
        return build_planner(problem, config).planner
