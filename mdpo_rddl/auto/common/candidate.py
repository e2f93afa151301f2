"""A policy that an arm has found, and what the judge says of it."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np

from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.policy.plan_rule import PlanRule, Simulated
from mdpo_rddl.policy.relaxed_plans import RelaxedPlans
from mdpo_rddl.policy.table import ActionTable, Estimate

NOOP = "no-op"
"""Label of the policy that does nothing."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A policy that may become the result.

    Attributes:
      arm: name of the arm that found it.
      label: what it is, for people.
      config: of the planner that it belongs to.
      planner: compiled for the configuration; None if it has yet to be built here, or if the
        policy needs none.
      params: parameters of one policy; None of one that needs no planner.
      policy_hyperparams: JaxPlan's policy hyperparameters.
      parents: names of the arms whose policies it was made from, the earliest first.
      uses_noise: whether it, or what it was made from, was trained with noise on the actions.
      table: of the actions, with what is known of its return, if the policy is one that trials
        have found.
      plans: how relaxed plans are made, with what simulated episodes have returned, if the policy
        plays by them.
      relaxed: what makes them; None if it has yet to be made here.
      mean, error: of its return on the exact model, by the judge; `mean` is None before that.
      returns: of the judge's rollouts [N], which are common to all; None if it has played none.
    """

    arm: str
    label: str
    config: PlannerConfig
    planner: MDPOPlanner | None
    params: Any
    policy_hyperparams: Mapping[str, Any] = field(default_factory=dict)
    parents: tuple[str, ...] = ()
    uses_noise: bool = False
    table: tuple[ActionTable, Estimate] | None = None
    plans: tuple[PlanRule, Simulated] | None = None
    relaxed: RelaxedPlans | None = None
    mean: float | None = None
    error: float = float("inf")
    returns: np.ndarray | None = None

    @property
    def known_mean(self) -> float:
        """The judge's mean.

        Raises:
          ValueError: if the candidate was not judged.
        """
        if self.mean is None:
            raise ValueError(f"{self.label}: not judged yet")
        return self.mean

    def child(self, arm: str, label: str, params: Any) -> "Candidate":
        """A candidate of the same planner that was made from this one, not judged yet."""
        parents = tuple(dict.fromkeys((*self.parents, self.arm)))
        return dataclasses.replace(
            self,
            arm=arm,
            label=label,
            params=params,
            parents=parents,
            mean=None,
            error=float("inf"),
            returns=None,
        )


def has_structure(planner: MDPOPlanner, params: Any, policy_hyperparams: Mapping[str, Any]) -> bool:
    """Whether parameters have the shapes of a planner's.

    Args:
      planner: compiled.
      params: of one policy, whoever found it.
      policy_hyperparams: that go with them.
    """
    structure = planner.params_structure(dict(policy_hyperparams))
    wanted, found = (
        jax.tree.map(lambda leaf: tuple(leaf.shape), tree) for tree in (structure, params)
    )
    return bool(wanted == found)


@dataclass(frozen=True, eq=False)
class Judged:
    """A candidate at the time when the judge played it.

    Attributes:
      candidate: with its mean and error; a mean that is not finite is minus infinity.
      seconds: since the race began.
      became_incumbent: whether it was better than all before it, by what is known of them now.
    """

    candidate: Candidate
    seconds: float
    became_incumbent: bool
