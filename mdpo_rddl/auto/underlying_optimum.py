"""The optimum of the underlying MDP, where its states can be enumerated in a part of the time."""

import dataclasses
import logging
from collections.abc import Callable

from mdpo_rddl.auto.arms.dynamic_programming import DynamicProgrammingArm
from mdpo_rddl.auto.optimum import Solution
from mdpo_rddl.auto.options import RaceOptions
from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.table_policy import TablePolicy
from mdpo_rddl.problem.enumeration.discrete import is_discrete
from mdpo_rddl.problem.errors_in_play import NoConditionError
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.underlying import underlying_mdp

logger = logging.getLogger(__name__)

# of the time
_SHARE = 0.25
# what an error costs at a step, in the returns of as many optimal episodes in which none costs
# anything: one ends the evaluation of a policy
_ERROR_EPISODES = 100.0


def underlying_optimum(
    problem: Problem,
    underlying: Problem,
    config: PlannerConfig,
    seed: int,
    options: RaceOptions,
    deadline: float,
) -> TablePolicy | None:
    """What an optimal policy plays that sees the state; None if it is not found in time.

    Where the environment raises an error for some actions, an error costs the return of many
    episodes.

    Args:
      problem: whose state is observed in part only.
      underlying: its underlying MDP.
      config: of the race.
      seed: of everything that is drawn.
      options: of the race.
      deadline: of everything, by the clock.
    """
    if not is_discrete(underlying):
        return None
    options.on_stage("enumerating")
    clock = options.clock
    until = min(clock() + _SHARE * config.budget().seconds, deadline)

    def solution(mdp: Problem) -> Solution | None:
        exact = DynamicProgrammingArm(mdp, config, clock, keeps_values=True)
        exact.work(until)
        return exact.solution

    found = solution(underlying)
    if found is not None and problem.raises:
        found = _charged(problem, found, solution)
    return None if found is None else found.policy(seed)


def _charged(
    problem: Problem, free: Solution, solution: Callable[[Problem], Solution | None]
) -> Solution | None:
    """What is optimal where errors have their cost, as a solution of the problem without it.

    Args:
      problem: whose state is observed in part only.
      free: of its underlying MDP, in which errors cost nothing.
      solution: finds the optimum of another one.
    """
    cost = _ERROR_EPISODES * abs(free.value)
    if not cost:
        return None
    try:
        found = solution(underlying_mdp(problem, cost))
    except (InputError, NoConditionError) as error:
        logger.info("what an error costs is not known: %s", one_line_cause(error))
        return None
    # the states and the actions are the same
    return None if found is None else dataclasses.replace(found, problem=free.problem)
