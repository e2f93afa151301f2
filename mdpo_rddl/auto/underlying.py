"""A policy of the underlying MDP beside the one that plays with what is observed."""

import dataclasses
import logging

from mdpo_rddl.auto.options import RaceOptions
from mdpo_rddl.auto.race import plan_automatically
from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.underlying import underlying_mdp

logger = logging.getLogger(__name__)

_SHARE = 0.4


def underlying_seconds(problem: Problem, seconds: float) -> float:
    """How much of the time for planning goes to the underlying MDP, where thinking is asked for.

    Args:
      problem: none is wanted of one whose state is observed.
      seconds: for planning, without what the choice of how to think has.
    """
    return _SHARE * seconds if problem.model.observ_fluents else 0.0


def with_underlying(
    policy: AnyPolicy, config: PlannerConfig, options: RaceOptions | None = None
) -> AnyPolicy:
    """The policy with what a second race finds for its underlying MDP.

    Args:
      policy: of a problem whose state is observed in part only; others are returned as they are.
      config: of the race, as `plan_automatically` takes it.
      options: of the race.

    Raises:
      KeyboardInterrupt: if the second race was interrupted.
    """
    if not isinstance(policy, Policy) or not policy.problem.model.observ_fluents:
        return policy
    try:
        problem = underlying_mdp(policy.problem)
        found = plan_automatically(problem, config, policy.seed, options)
    except InputError as error:
        logger.warning("no policy of the underlying MDP: %s", one_line_cause(error))
        return policy
    if found.interrupted:
        raise KeyboardInterrupt
    return dataclasses.replace(policy, saved_underlying=found.policy.to_saved())
