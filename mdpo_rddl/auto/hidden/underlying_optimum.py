"""The optimum of the underlying MDP, where its states can be enumerated in a part of the time."""

import logging
from collections.abc import Callable

from mdpo_rddl.auto.arms.dynamic_programming import DynamicProgrammingArm
from mdpo_rddl.auto.race.options import RaceOptions
from mdpo_rddl.auto.search.optimum import Solution
from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.table_policy import TablePolicy
from mdpo_rddl.problem.enumeration.discrete import is_discrete
from mdpo_rddl.problem.errors_in_play import NoConditionError, error_condition
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.underlying import underlying_mdp

logger = logging.getLogger(__name__)

# of the time
_SHARE = 0.25
# what an error costs at a step, in the returns of as many optimal episodes: an error ends not only
# its episode, but whatever is made of episodes, as a mean return
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
    if problem.raises and not _is_known(problem):
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
        found = _charged(problem, found.value, solution)
    return None if found is None else found.policy(seed)


def _is_known(problem: Problem) -> bool:
    """Whether it is known when the environment raises an error."""
    try:
        error_condition(problem.model)
    except NoConditionError as error:
        logger.info("what an error costs is not known: %s", error)
        return False
    return True


def _charged(
    problem: Problem, value: float, solution: Callable[[Problem], Solution | None]
) -> Solution | None:
    """What is optimal in the underlying MDP where errors have their cost.

    Args:
      problem: whose state is observed in part only.
      value: of the optimum where errors cost nothing.
      solution: finds the optimum of a problem.
    """
    if value == 0.0:
        logger.info("what an error costs is not known: the optimum returns 0 without it")
        return None
    try:
        found = solution(underlying_mdp(problem, _ERROR_EPISODES * abs(value)))
    except InputError as error:
        logger.info("no underlying MDP with the costs of errors: %s", one_line_cause(error))
        return None
    # without values a majority of particles would vote, whatever an error costs the others
    return None if found is None or found.table.values is None else found
