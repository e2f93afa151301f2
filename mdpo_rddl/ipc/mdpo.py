"""Our planner."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mdpo_rddl.auto import plan_automatically
from mdpo_rddl.ipc.gradient import training_seconds
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import DEFAULT_PRESET, PRESETS
from mdpo_rddl.policy.file import load_policy, save_policy
from mdpo_rddl.policy.kinds import AnyPolicy, restored
from mdpo_rddl.problem.episode import tell_played
from mdpo_rddl.problem.legal_moves import LegalMoves
from mdpo_rddl.problem.load import Problem, make_environment

_FILE = "policy.safetensors"

ConfigChange = Callable[[PlannerConfig], PlannerConfig]


def _unchanged(config: PlannerConfig) -> PlannerConfig:
    return config


class MDPO:
    """Finds a policy by the default preset, and plays a legal action near the policy's.

    Attributes:
      found_by: the arm that found the policy, after those whose policies it began with; empty
        before `prepare`, and where a policy was restored.
    """

    found_by: tuple[str, ...] = ()

    def __init__(self, change: ConfigChange = _unchanged) -> None:
        """Prepares nothing yet.

        Args:
          change: of the preset's configuration.
        """
        self._change = change

    def prepare(self, problem: Problem, seconds: float, seed: int) -> None:
        """Looks for a policy for the time given, less a margin."""
        self._take_up(self._find(problem, training_seconds(seconds), seed))

    def save(self, folder: Path) -> None:
        """Writes the policy."""
        save_policy(folder / _FILE, self._policy.to_saved())

    def restore(self, problem: Problem, folder: Path) -> None:
        """Reads the policy and compiles it."""
        path = folder / _FILE
        self._take_up(restored(load_policy(path), problem, str(path)))

    def act(
        self, step: int, state: Mapping[str, Any], rng: np.random.Generator
    ) -> Mapping[str, Any]:
        """What the policy does if it is legal; it draws nothing."""
        legal = self._moves.rule(self._policy(step, state), state).actions
        tell_played(self._policy, legal)
        return legal

    def _find(self, problem: Problem, seconds: float, seed: int) -> AnyPolicy:
        """A policy, after so many seconds with compilation."""
        outcome = plan_automatically(problem, self._config(problem, seconds), seed)
        self.found_by = (*outcome.chosen.parents, outcome.chosen.arm)
        return outcome.policy

    def _config(self, problem: Problem, seconds: float) -> PlannerConfig:
        """Of a race of so many seconds."""
        config = self._change(PRESETS[DEFAULT_PRESET](problem.domain_name))
        return config.with_values("Optimize", train_seconds=seconds)

    def _take_up(self, policy: AnyPolicy) -> None:
        self._policy, self._moves = policy, LegalMoves(policy.problem)
        state, _ = make_environment(policy.problem).reset(seed=0)
        policy(0, state)  # compiles it
