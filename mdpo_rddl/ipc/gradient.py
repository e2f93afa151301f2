"""What JaxPlan's planners have in common: a policy that is trained, kept and played."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.file import SavedPolicy, load_parameters, problem_identity, save_policy
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.grounding import require_observation, require_step
from mdpo_rddl.problem.load import Problem, make_environment

_FILE = "policy.safetensors"
# for what comes after training: an iteration that is on its way, and the policy's compilation
_MARGIN_SHARE, _MOST_MARGIN_SECONDS = 0.15, 30.0


class Found(NamedTuple):
    """A policy and what it takes to play it.

    Attributes:
      planner: compiled for the configuration.
      config: of the planner.
      params, hyperparams: of the policy.
    """

    planner: Any
    config: PlannerConfig
    params: Any
    hyperparams: dict[str, Any]


def training_seconds(seconds: float, most_margin: float = _MOST_MARGIN_SECONDS) -> float:
    """What a training may take of the time for a preparation: all but a margin.

    Args:
      seconds: of the preparation.
      most_margin: seconds that the margin has at most.
    """
    return max(seconds - min(_MARGIN_SHARE * seconds, most_margin), 1.0)


class GradientPlanner(ABC):
    """A planner that trains the parameters of a policy and then plays it."""

    def prepare(self, problem: Problem, seconds: float, seed: int) -> None:
        """Trains for the time given, less a margin."""
        found = self._find(problem, training_seconds(seconds), seed)
        self._saved = SavedPolicy(
            params=found.params,
            policy_hyperparams=found.hyperparams,
            config=found.config.to_text(),
            problem=problem_identity(problem),
            seed=seed,
        )
        self._take_up(problem, found.planner)

    def save(self, folder: Path) -> None:
        """Writes the policy."""
        save_policy(folder / _FILE, self._saved)

    def restore(self, problem: Problem, folder: Path) -> None:
        """Reads the policy and compiles it."""
        self._saved = load_parameters(folder / _FILE)
        planner = self._build(problem, PlannerConfig.from_text(self._saved.config))
        self._take_up(problem, planner)

    def act(
        self, step: int, state: Mapping[str, Any], rng: np.random.Generator
    ) -> Mapping[str, Any]:
        """What the policy does; it draws nothing.

        Raises:
          InputError: if there is no such step, or the state is none of the problem's.
        """
        require_step(self._model, step)
        require_observation(self._model, state)
        return self._policy(step, state)

    @abstractmethod
    def _find(self, problem: Problem, seconds: float, seed: int) -> Found:
        """A policy, after so many seconds with compilation."""

    @abstractmethod
    def _build(self, problem: Problem, config: PlannerConfig) -> Any:
        """The planner of a configuration."""

    def _take_up(self, problem: Problem, planner: Any) -> None:
        saved, self._model = self._saved, problem.model
        self._policy = playable(planner, saved.params, saved.policy_hyperparams, saved.seed)
        state, _ = make_environment(problem).reset(seed=0)
        self._policy(0, state)  # compiles it
