"""A policy that makes a relaxed plan at each decision."""

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.html import html_table
from mdpo_rddl.policy.agent import PolicyAgent
from mdpo_rddl.policy.file import SavedPlanRule, problem_identity, require_same_problem
from mdpo_rddl.policy.plan_rule import PlanRule, Simulated
from mdpo_rddl.policy.plannerless import PlannerlessPolicy, numbers_of
from mdpo_rddl.policy.relaxed_plans import RelaxedPlans
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import open_model
from mdpo_rddl.problem.load import Problem, make_environment
from mdpo_rddl.problem.source import ProblemSource

# the longest that the ground model of a saved policy may take
_GROUNDING_SECONDS = 600.0


class RelaxedPlanPolicy(PlannerlessPolicy):
    """Plays by relaxed plans (`mdpo_rddl.policy.relaxed_plans`).

    Attributes:
      plan_rule: how they are made.
      claim: what simulated episodes have returned.
    """

    name = "relaxed plans"

    def __init__(
        self,
        problem: Problem,
        rule: PlanRule,
        claim: Simulated,
        seed: int,
        plans: RelaxedPlans | None = None,
    ) -> None:
        """Makes the ground model if there is none, which lasts seconds on a large problem.

        Args:
          problem: that is played.
          rule: how plans are made.
          claim: see the class.
          seed: of the run; what a decision draws depends on it and on the step alone.
          plans: of the problem's ground model.

        Raises:
          InputError: if there can be no plans of the problem.
        """
        super().__init__(problem, claim, seed)
        self.plan_rule, self.claim = rule, claim
        self._plans = _plans_of(problem) if plans is None else plans

    @classmethod
    def from_saved(cls, saved: SavedPlanRule, problem: Problem, source: str) -> "RelaxedPlanPolicy":
        """Rebuilds a saved policy.

        Args:
          saved: the rule.
          problem: on which to play it.
          source: where it came from, for error messages.

        Raises:
          InputError: if it was saved for another problem, or there can be no plans of this one.
        """
        require_same_problem(saved, problem, source)
        return cls(problem, saved.rule, saved.claim, saved.seed)

    def to_saved(self) -> SavedPlanRule:
        """The policy as a file holds it."""
        source = ProblemSource.of(self.problem).without_folders()
        identity = problem_identity(self.problem)
        return SavedPlanRule(self.plan_rule, self.claim, identity, self.seed, source)

    @property
    def kind(self) -> str:
        """Relaxed plans."""
        return "a relaxed plan at each decision"

    def with_decision_seconds(self, seconds: float) -> PolicyAgent:
        """The policy itself: it plans at each decision as it is.

        Args:
          seconds: of a decision, which is not used.
        """
        del seconds
        return self

    def __repr__(self) -> str:
        return f"<RelaxedPlanPolicy for {self.problem.label}: {self.plan_rule}>"

    def _repr_html_(self) -> str:
        rows = {
            "domain, instance": f"{self.problem.domain_name}, {self.problem.instance_name}",
            "horizon": f"{self.problem.horizon:,}",
            "plan": self.name,
            "return": f"{self.claim.value:z,.6g}",
            "seed": f"{self.seed}",
        }
        return html_table(f"Policy for {self.problem.label}", rows)

    def actions_in(self, step: int, states: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """What is played at a step in each of N states.

        Args:
          step: number of decisions before.
          states: per state fluent [N, *shape].

        Returns:
          Per action fluent [N, *shape].
        """
        plans, model = self._plans, self._plans.model
        rows = [
            numbers_of(states[name], model.objects.get(kind, ())).reshape(len(states[name]), -1)
            for name, kind in self._fluents.items()
        ]
        uniform = plans.uniform(self.seed, step, self.plan_rule)
        decided = plans.decide(np.concatenate(rows, axis=1).T, step, self.plan_rule, uniform)
        found = [plans.actions.by_fluent(action) for action in decided.T]
        return {
            name: np.stack([each[name].astype(like.dtype).reshape(like.shape) for each in found])
            for name, like in self._noop.items()
        }

    def batch(self, step: int, observations: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """As `PolicyAgent.batch`, with the plans of all states made together."""
        return self.actions_in(step, observations)

    def _act(self, step: int, observation: Mapping[str, Any]) -> dict[str, Any]:
        state = {name: np.asarray(observation[name])[np.newaxis] for name in self._fluents}
        return {name: each[0][()] for name, each in self.actions_in(step, state).items()}

    @cached_property
    def _fluents(self) -> dict[str, str]:
        """Of the state fluents, in the order of the model's variables, the ranges."""
        model = self._plans.model
        names = (name for name, _ in model.variables)
        return dict(zip(names, model.ranges, strict=True))

    @cached_property
    def _noop(self) -> dict[str, np.ndarray]:
        sampler = make_environment(self._problem).sampler
        return {name: np.asarray(value) for name, value in sampler.noop_actions.items()}


def _plans_of(problem: Problem) -> RelaxedPlans:
    limits = EnumerationLimits(_GROUNDING_SECONDS)
    try:
        return RelaxedPlans(open_model(problem, limits), limits)
    except NotEnumerableError as error:
        raise InputError(f"{problem.label}: no relaxed plans: {error}") from error
