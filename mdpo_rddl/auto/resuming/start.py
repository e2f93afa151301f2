"""A policy to begin a race with: of the same problem, or of another instance of the domain."""

import logging

import jax

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.policy.relaxed_plan_policy import RelaxedPlanPolicy
from mdpo_rddl.policy.transfer import transferred
from mdpo_rddl.problem.load import Problem

logger = logging.getLogger(__name__)

START = "given policy"


def accepted_start(policy: AnyPolicy, problem: Problem) -> Policy:
    """The policy, if a race can begin with it.

    Raises:
      InputError: if it is of another domain, or of another instance and no lifted rule.
    """
    ours, theirs = problem.domain_name, policy.problem.domain_name
    if ours != theirs:
        raise InputError(f"cannot start from a policy of the domain {theirs!r}: it is not {ours!r}")
    if isinstance(policy, RelaxedPlanPolicy):
        raise InputError("cannot start from relaxed plans: they are made anew at each decision")
    if not isinstance(policy, Policy):
        raise InputError("cannot start from a table: it holds actions for its own states only")
    if not _is_lifted(policy) and not _is_same(policy, problem):
        raise InputError(
            f"cannot start from a policy of {policy.problem.label} that is no lifted rule: "
            "it fits its own instance only"
        )
    return policy


def start_candidates(arena: Arena, policy: Policy | None) -> list[Candidate]:
    """What a race begins with: the policy in the arena's units, for its judge.

    What does not fit is logged.

    Args:
      arena: of the problem to plan.
      policy: that `accepted_start` has accepted; None for no candidate.
    """
    if policy is None:
        return []
    is_same, known = _is_same(policy, arena.problem), (policy.planner, policy.params)
    own = Candidate(START, START, policy.config, *known, policy.policy_hyperparams)
    if not _is_lifted(policy):
        return [own]
    source, params = policy.planner.feedback_plan, policy.params
    carried = transferred(source, params, arena.plan, arena.noop, is_same)
    if carried.left_out:
        logger.warning(
            "of the policy of %s was left out: %s",
            policy.problem.label,
            ", ".join(carried.left_out),
        )
    params = jax.tree.map(lambda leaf, like: leaf.astype(like.dtype), carried.params, arena.noop)
    candidates = [arena.candidate(START, START, params)]
    if is_same and carried.left_out:
        # the arena's planner plays less than what was given
        candidates.append(own)
    return candidates


def _is_lifted(policy: Policy) -> bool:
    return isinstance(policy.planner.plan, FeedbackPlan)


def _is_same(policy: Policy, problem: Problem) -> bool:
    same_texts = policy.problem.digest == problem.digest
    return same_texts and policy.problem.horizon == problem.horizon
