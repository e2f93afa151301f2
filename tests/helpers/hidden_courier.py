"""Policies of the courier who does not see the parcel: the no-op, and relaxed plans."""

import functools

import numpy as np

from helpers.couriers import hidden_courier
from helpers.lakes import preset
from mdpo_rddl.policy.formula import FeedbackFormula
from mdpo_rddl.policy.plan_rule import PlanRule, Simulated
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.policy.relaxed_plan_policy import RelaxedPlanPolicy
from mdpo_rddl.problem.underlying import underlying_mdp


@functools.cache
def idle() -> Policy:
    """Does nothing."""
    problem = hidden_courier()
    config = preset(1.0).without_section("Search").with_policy_arguments(topology=[], plan=False)
    feedback = FeedbackFormula(problem, config).actions.feedback
    return Policy(problem, config, feedback.initial(np.random.default_rng(0)), {}, 0)


@functools.cache
def planning() -> RelaxedPlanPolicy:
    """Plans where the parcel is seen."""
    claim = Simulated(9.0, 0.5, 16)
    return RelaxedPlanPolicy(underlying_mdp(idle().problem), PlanRule(), claim, seed=3)
