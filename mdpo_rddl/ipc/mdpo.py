"""Our planner."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mdpo_rddl.ipc.gradient import training_seconds
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import DEFAULT_PRESET, PRESETS
from mdpo_rddl.policy.file import load_policy, save_policy
from mdpo_rddl.policy.kinds import AnyPolicy, restored
from mdpo_rddl.problem.episode import tell_played
from mdpo_rddl.problem.legal_moves import LegalMoves
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.race.budget import Budget
from mdpo_rddl.race.race import race

_FILE = "policy.safetensors"
# for what comes after the race
_MOST_MARGIN_SECONDS = 2.0

ConfigChange = Callable[[PlannerConfig], PlannerConfig]


def race_seconds(seconds: float) -> float:
    """What the race may take of the time for a preparation, which it keeps by itself."""
    return training_seconds(seconds, _MOST_MARGIN_SECONDS)


def _unchanged(config: PlannerConfig) -> PlannerConfig:
    return config


class MDPO:
    """Finds a policy by the default preset, and plays a legal action near the policy's.

    Attributes:
      found_by: the arm that found the policy, after those whose policies it began with; empty
        before `prepare`, and where a policy was restored.
    """

    found_by: tuple[str, ...] = ()

    def __init__(
        self, change: ConfigChange = _unchanged, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        """Prepares nothing yet.

        Args:
          change: of the preset's configuration.
          clock: tells the seconds.
        """
        self._change, self._clock = change, clock

    def prepare(self, problem: Problem, seconds: float, seed: int) -> None:
        """Looks for a policy for the time given, less a margin."""
        self._take_up(self._find(problem, race_seconds(seconds), seed))

    def save(self, folder: Path) -> None:
        """Writes the policy."""
        save_policy(folder / _FILE, self._policy.to_saved())

    def restore(self, problem: Problem, folder: Path) -> None:
        """Reads the policy."""
        path = folder / _FILE
        self._take_up(restored(load_policy(path), problem, str(path)))

    def act(
        self, step: int, state: Mapping[str, Any], rng: np.random.Generator
    ) -> Mapping[str, Any]:
        """What the policy does if it is legal; it draws nothing.

        Raises:
          InputError: if there is no such step, or the state is none of the problem's.
        """
        legal = self._moves.rule(self._policy(step, state), state).actions
        tell_played(self._policy, legal)
        return legal

    def _find(self, problem: Problem, seconds: float, seed: int) -> AnyPolicy:
        """A policy, after so many seconds."""
        budget = Budget.of(seconds, self._clock)
        outcome = race(problem, self._config(problem), budget, seed)
        self.found_by = (*outcome.chosen.parents, outcome.chosen.arm)
        return outcome.policy

    def _config(self, problem: Problem) -> PlannerConfig:
        """Of the race."""
        return self._change(PRESETS[DEFAULT_PRESET](problem.domain_name))

    def _take_up(self, policy: AnyPolicy) -> None:
        self._policy, self._moves = policy, LegalMoves(policy.problem)
