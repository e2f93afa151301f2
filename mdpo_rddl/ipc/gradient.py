"""What planners of JaxPlan's kind have in common: a policy that is trained, kept and played."""

import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mdpo_rddl.jaxplan.config import PlannerConfig
from mdpo_rddl.planning import playable
from mdpo_rddl.problem import Problem, make_environment
from mdpo_rddl.report.policy_file import (
    SavedPolicy,
    load_policy,
    problem_identity,
    save_policy,
)

_FILE = "policy.safetensors"
# for what comes after training: an iteration that is on its way, and the policy's compilation
_MARGIN_SHARE, _MOST_MARGIN_SECONDS = 0.15, 30.0


class GradientPlanner(ABC):
    """A planner that trains the parameters of a policy and then plays it."""

    def prepare(self, problem: Problem, seconds: float, seed: int) -> None:
        """Trains for the time given, less a margin."""
        started = time.perf_counter()
        config = self._config(problem)
        planner, arguments = self._build(problem, config)
        margin = min(_MARGIN_SHARE * seconds, _MOST_MARGIN_SECONDS)
        left = seconds - margin - (time.perf_counter() - started)
        params, hyperparams = self._train(planner, arguments, seed, max(left, 1.0))
        self._saved = SavedPolicy(
            params=params,
            policy_hyperparams=hyperparams,
            config=config.to_text(),
            problem=problem_identity(problem),
            seed=seed,
        )
        self._take_up(problem, planner)

    def save(self, folder: Path) -> None:
        """Writes the policy."""
        save_policy(folder / _FILE, self._saved)

    def restore(self, problem: Problem, folder: Path) -> None:
        """Reads the policy and compiles it."""
        self._saved = load_policy(folder / _FILE)
        planner, _ = self._build(problem, PlannerConfig.from_text(self._saved.config))
        self._take_up(problem, planner)

    def act(
        self, step: int, state: Mapping[str, Any], rng: np.random.Generator
    ) -> Mapping[str, Any]:
        """What the policy does; it draws nothing."""
        return self._policy(step, state)

    @abstractmethod
    def _config(self, problem: Problem) -> PlannerConfig:
        """The configuration for a problem."""

    @abstractmethod
    def _build(self, problem: Problem, config: PlannerConfig) -> tuple[Any, dict[str, Any]]:
        """The planner, and the configuration's arguments of `optimize`."""

    @abstractmethod
    def _train(
        self, planner: Any, arguments: dict[str, Any], seed: int, seconds: float
    ) -> tuple[Any, dict[str, Any]]:
        """Parameters and policy hyperparameters, after so many seconds with compilation."""

    def _take_up(self, problem: Problem, planner: Any) -> None:
        saved = self._saved
        self._policy = playable(planner, saved.params, saved.policy_hyperparams, saved.seed)
        state, _ = make_environment(problem).reset(seed=0)
        self._policy(0, state)  # compiles it
