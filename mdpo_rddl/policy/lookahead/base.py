"""What improves a policy at a decision: the interface of the methods."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from mdpo_rddl.planner.climbing import Ascent
from mdpo_rddl.planner.exact.filtering import ParticleFilter
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.parts import with_effect
from mdpo_rddl.policy.lookahead.components import Components
from mdpo_rddl.policy.plan_rule import PlanRule
from mdpo_rddl.policy.table import ActionTable, Optimum
from mdpo_rddl.problem.load import Problem


class Prepared(Protocol):
    """A policy that was prepared, with the planner that was compiled for it."""

    @property
    def problem(self) -> Problem:
        """What is played."""

    @property
    def planner(self) -> MDPOPlanner:
        """Its models."""

    @property
    def rollout_policy(self) -> Callable[..., Any]:
        """A function as `planner.legal_policy`, which plays in compiled rollouts."""

    @property
    def params(self) -> Any:
        """Of the policy."""

    @property
    def policy_hyperparams(self) -> Mapping[str, Any]:
        """JaxPlan's, which go with the parameters."""

    @property
    def seed(self) -> int:
        """Of whatever is drawn."""

    @property
    def underlying(self) -> "Prepared | Tabled | ByPlans | None":
        """A policy of the underlying MDP, where the state is observed in part only, if any."""

    @property
    def vote(self) -> "Vote | None":
        """How it is played, if that is by a vote over a belief."""

    def __call__(self, step: int, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        """The action at a step."""

    def save(self, path: str | Path) -> None:
        """Writes it to a file."""


@dataclass(frozen=True, eq=False)
class Vote:
    """How a policy is played where the particles of a belief vote.

    Attributes:
      elect: gives the action per fluent [*shape] at a step from particles per fluent [P, *shape].
      particles: P.
      filter: that the particles are of.
    """

    elect: Callable[[int, Mapping[str, Any]], Mapping[str, Any]]
    particles: int
    filter: ParticleFilter


def rollout_params(policy: Prepared) -> Any:
    """Parameters with which its `rollout_policy` plays: of a feedback policy what has an effect."""
    planner = policy.planner
    is_own = policy.rollout_policy is planner.legal_policy
    if is_own and isinstance(planner.plan, FeedbackPlan):
        return with_effect(policy.params)
    return policy.params


@runtime_checkable
class Tabled(Protocol):
    """A table of actions, which is played as a policy."""

    table: ActionTable
    seed: int

    @property
    def problem(self) -> Problem:
        """What is played."""

    @property
    def optimum(self) -> Optimum | None:
        """What is proven of it; None if nothing is."""

    def knows(self, observation: Mapping[str, Any]) -> bool:
        """Whether a state is in the table; in others the no-op is played."""

    def __call__(self, step: int, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        """The action at a step."""

    def save(self, path: str | Path) -> None:
        """Writes it to a file."""


@runtime_checkable
class ByPlans(Protocol):
    """A policy that makes a plan at each decision as it is."""

    plan_rule: PlanRule

    @property
    def problem(self) -> Problem:
        """What is played."""

    def actions_in(self, step: int, states: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
        """The actions per fluent [N, *shape] at a step in states per fluent [N, *shape]."""


@dataclass(frozen=True)
class Gain:
    """What a candidate returned more than the base on the same scenarios.

    Attributes:
      candidate: [k, D].
      mean: over the scenarios.
      error: the mean's standard error.
      steps: until the candidate's last difference from the base.
    """

    candidate: np.ndarray
    mean: float
    error: float
    steps: int = 1

    @property
    def rate(self) -> float:
        """What is gained a step.

        By the gain itself a change that is put off would be put off again at each decision: what
        the policy does now is mostly worth more than what it is expected to do later.
        """
        return self.mean / self.steps


@dataclass(frozen=True)
class Climbed:
    """Where gradient steps have led.

    Attributes:
      ascent: of P candidates [P, k, D], to go on from.
      sigma: deviation of MDPO's adaptive noise at each step of the candidates that were given, in
        units of the components, the largest being 1 [P, k].
    """

    ascent: Ascent
    sigma: np.ndarray


@dataclass(frozen=True)
class Situation:
    """What a decision begins with.

    Attributes:
      base: the prepared policy's action [D].
      capacity: so many candidates are played in one call.
      climb: gradient steps on as many candidates as climb side by side, with rates [P], in units of
        the components, for a share of the time of the search; None where there is no time for a
        step.
      climbers: that many climb.
    """

    base: np.ndarray
    capacity: int
    climb: Callable[[Ascent, np.ndarray, float], Climbed | None]
    climbers: int = 1


class Method(Protocol):
    """Proposes candidates for the state at hand.

    A candidate is an array [k, D] over an action's D components: the action to play, and how the
    policy's actions are changed at the k - 1 steps after it, as
    `mdpo_rddl.planner.exact.continuations.Continuations` says. Those with an illegal action to play
    are left out by whoever asks.

    Attributes:
      name: for the summary.
      depth: number of steps k.
      rounds: how often it proposes at one decision.
      climbs: whether it asks for gradient steps, which are compiled for it then.
      is_for_chance: whether it can gain where chance plays a part.
    """

    @property
    def name(self) -> str:
        """For the summary."""

    @property
    def depth(self) -> int:
        """Number of steps k."""

    @property
    def rounds(self) -> int:
        """How often it proposes at one decision."""

    def applies(self, components: Components) -> bool:
        """Whether the problem's actions are of a kind that it can change."""

    @property
    def climbs(self) -> bool:
        """Whether it asks for gradient steps, which are compiled for it then."""

    @property
    def is_for_chance(self) -> bool:
        """Whether it can gain where chance plays a part."""

    def begin(self, situation: Situation) -> None:
        """A decision begins."""

    def propose(self, gains: Sequence[Gain], random: np.random.Generator) -> np.ndarray:
        """Candidates [P, k, D], the most promising first; none ends the search.

        Args:
          gains: of what was proposed last, the largest first; empty in the first round.
          random: source of random numbers.
        """

    def shift(self, chosen: np.ndarray) -> None:
        """One step was played: what is known moves on with it.

        Args:
          chosen: the candidate that was played, with what is planned after its own steps [n, D];
            n is at least k.
        """

    def reset(self) -> None:
        """A new episode begins."""

    def resume(self, changes: np.ndarray) -> None:
        """A new episode begins, and a plan for it is known.

        Args:
          changes: of the policy's actions, the first one too, at the steps to come [n, D], as
            `Components.changes` gives them; n is at least k.
        """
