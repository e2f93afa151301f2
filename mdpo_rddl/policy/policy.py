"""A policy with all that belongs to it: the problem, the configuration and the compiled planner."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.policy.file import SavedPolicy, problem_identity, require_same_problem
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem import evaluation
from mdpo_rddl.problem.load import Problem


@dataclass(frozen=True, eq=False)
class Policy:
    """A policy of one problem that can be played and saved.

    Attributes:
      problem: the parsed problem.
      config: the planner's configuration.
      planner: compiled for it.
      params: parameters of one policy, a tree of arrays.
      policy_hyperparams: JaxPlan's policy hyperparameters that go with them.
      seed: of the run that found it, and of a policy that draws random numbers.
    """

    problem: Problem
    config: PlannerConfig
    planner: MDPOPlanner
    params: Any
    policy_hyperparams: Mapping[str, Any]
    seed: int

    @classmethod
    def from_saved(cls, saved: SavedPolicy, problem: Problem, source: str) -> "Policy":
        """Compiles what plays a saved policy.

        Args:
          saved: the policy.
          problem: on which to play it, with whatever horizon the policy can be played for.
          source: where the policy came from, for error messages.

        Raises:
          InputError: if it was saved for another problem, its configuration cannot be used,
            or its tensors do not fit.
        """
        require_same_problem(saved, problem, source)
        config = PlannerConfig.from_text(saved.config, source)
        planner = build_planner(problem, config).planner
        _require_params(saved, planner, source)
        hyperparams = saved.policy_hyperparams
        return cls(problem, config, planner, saved.params, hyperparams, saved.seed)

    def to_saved(self) -> SavedPolicy:
        """The policy as a file holds it, without the compiled planner."""
        return SavedPolicy(
            params=self.params,
            policy_hyperparams=dict(self.policy_hyperparams),
            config=self.config.to_text(),
            problem=problem_identity(self.problem),
            seed=self.seed,
        )

    def with_params(self, params: Any) -> "Policy":
        """The policy with other parameters of the same planner."""
        return dataclasses.replace(self, params=params)

    def __call__(self, step: int, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        """The action tensor per fluent at a step, for an observation per fluent."""
        return self._play(step, observation)

    @cached_property
    def _play(self) -> evaluation.Policy:
        return playable(self.planner, self.params, self.policy_hyperparams, self.seed)


def _require_params(saved: SavedPolicy, planner: MDPOPlanner, source: str) -> None:
    expected = planner.params_structure(saved.policy_hyperparams)
    wanted = jax.tree.map(lambda leaf: leaf.shape, expected)
    tensors = jax.tree.map(lambda leaf: leaf.shape, saved.params)
    if wanted != tensors:
        raise InputError(
            f"{source}: damaged policy file, or saved for another horizon: its tensors are "
            f"{tensors}, expected {wanted}"
        )
