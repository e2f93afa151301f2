"""Planning where the state is observed in part only.

The optimum of the underlying MDP is looked for, and what a belief of the state elects by it is
compiled. Then the race looks for a policy that remembers; where there was no optimum, a second race
is for the underlying MDP. The vote and the race's policy are played in the same episodes, and the
better one is the result. The underlying policy stays with it for thinking at the decision, unless
it makes relaxed plans. Where the environment raises errors there is no second race.
"""

import dataclasses
import logging
import math
from collections.abc import Sequence

from mdpo_rddl.auto.arms.dynamic_programming import DYNAMIC_PROGRAMMING
from mdpo_rddl.auto.arms.relaxed_plans import RELAXED_PLANS
from mdpo_rddl.auto.hidden.underlying_optimum import underlying_optimum
from mdpo_rddl.auto.hidden.voting_trial import ACTION_VOTING, VotingTrial
from mdpo_rddl.auto.outcome.first_policy import first_policy
from mdpo_rddl.auto.outcome.outcome import RaceOutcome
from mdpo_rddl.auto.outcome.unjudged import ended_by, left_at, unjudged_outcome
from mdpo_rddl.auto.probing.raising import RAISING_SHARE, watched
from mdpo_rddl.auto.race.options import RaceOptions
from mdpo_rddl.auto.race.race import run_race
from mdpo_rddl.errors import Cancelled, InputError, note_heard, one_line_cause
from mdpo_rddl.machine.device import computing_on
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.search_section import SEARCH, read_search
from mdpo_rddl.planner.device import fitting_device
from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.underlying import underlying_mdp

logger = logging.getLogger(__name__)

_UNDERLYING = "underlying MDP"

# where there is no optimum, a race for the underlying MDP, of what is left beside the vote's trial
_RACE_SHARE = 0.6
# of what is left, how long it is waited for the vote of an optimum: an abandoned compilation would
# go on beside the race
_VOTE_SHARE = 0.9
# of what is left, and the most of it: the vote's compilation, if it comes after the race, and its
# and the race's policy's episodes
_TRIAL_SHARE, _TRIAL_SECONDS = 0.3, 15.0
_LEAST_SECONDS = 0.1
# for the no-op's episodes, where a stop comes before the race
_STOPPED_SECONDS = 1.0
# for a second race with relaxed plans: with less, the trial of their vote, which plays slowly, is
# too short
_PLANS_SECONDS = 20.0


def plan_partially_observed(
    problem: Problem, config: PlannerConfig, seed: int, options: RaceOptions
) -> RaceOutcome:
    """Finds a policy as `run_race` does, and whether a vote over the belief is a better one.

    Where the environment raises an error for some actions, only the vote of an optimum is tried.

    Args:
      problem: whose state is observed in part only.
      config: as for the race; its time is for everything.
      seed: of everything that is drawn.
      options: of the race.

    Raises:
      InputError: if JaxPlan refuses the problem or the configuration.
      KeyboardInterrupt: if interrupted before there was any policy.
    """
    clock = options.clock
    began, seconds = clock(), config.budget().seconds
    used = 0.0 if options.earlier is None else options.earlier.seconds
    search = read_search(config.sections)
    watched_until = began + RAISING_SHARE * seconds
    problem = watched(problem, lambda: clock() < watched_until)
    is_left_out = search is not None and ACTION_VOTING in search.without
    underlying = None if is_left_out else _underlying(problem)
    if underlying is None:
        left = seconds - (clock() - began)
        outcome = run_race(problem, _within(config, left), seed, options)
    else:
        given = config, seed, options, began - used
        outcome = _with_underlying(problem, underlying, *given)
    return dataclasses.replace(outcome, seconds=clock() - began + used)


def _with_underlying(
    problem: Problem,
    underlying: Problem,
    config: PlannerConfig,
    seed: int,
    options: RaceOptions,
    since: float,
) -> RaceOutcome:
    """The better one of the race's policy and of the vote of the underlying MDP's.

    The vote of an optimum is mostly the better one, and is compiled before the race: that knows no
    time then in which it would be too late.
    """
    clock, vote = options.clock, None
    used = 0.0 if options.earlier is None else options.earlier.seconds
    deadline = since + config.budget().seconds
    try:
        given = config, seed, options, deadline
        optimum = underlying_optimum(problem, underlying, *given)
        if optimum is None and problem.raises:
            # a vote that does not know what errors cost meets in play what no rollout has shown
            return run_race(problem, _within(config, used + deadline - clock()), seed, options)
        if optimum is not None:
            options.on_stage(_UNDERLYING)
            vote = VotingTrial(optimum, options)
            vote.compile_before(problem, config, seed, _VOTE_SHARE * (deadline - clock()))
        trial = min(_TRIAL_SHARE * (deadline - clock()), _TRIAL_SECONDS)
        if vote is not None and not vote.is_compiled:
            trial = 0.0
        # a race that goes on counts what was used before
        left = used + deadline - clock() - trial
        # with both judges' programs too late nothing at all would be found
        latest = deadline if vote is None else -math.inf
        patient = dataclasses.replace(options, at_the_latest=latest)
        share = 1.0 if vote is not None else 1.0 - _RACE_SHARE
        outcome = run_race(problem, _within(config, share * left), seed, patient)
    except (KeyboardInterrupt, Cancelled) as stop:
        note_heard(stop)
        return _stopped(stop, (problem, config, seed), options, since)
    if not isinstance(outcome.policy, Policy):
        return outcome
    if outcome.interrupted:
        return outcome if vote is None else vote.unplayed(outcome)
    try:
        left = deadline - trial - clock()
        if vote is None and left > 0.0:
            options.on_stage(_UNDERLYING)
            has_time = left >= _PLANS_SECONDS
            less = [] if has_time and _found_nothing(outcome) else [RELAXED_PLANS]
            found = _raced(underlying, _within(config, left), seed, options, less)
            vote = None if found is None else VotingTrial(found, options)
        if vote is None:
            return outcome
        options.on_stage(_UNDERLYING)
        return vote.played(outcome, since, deadline)
    except (KeyboardInterrupt, Cancelled) as stop:
        note_heard(stop)
        outcome = outcome if vote is None else vote.unplayed(outcome)
        return dataclasses.replace(outcome, interrupted=True)


def _stopped(
    stop: BaseException,
    planned: tuple[Problem, PlannerConfig, int],
    options: RaceOptions,
    since: float,
) -> RaceOutcome:
    """The outcome where no race has found anything yet: the no-op.

    Args:
      stop: what has ended it.
      planned: the problem, the configuration and the seed.
      options: of the race.
      since: when everything began, by the clock.

    Raises:
      BaseException: `stop`, if the no-op cannot be played in time, or an earlier race has left
        something better, which stays for the next one then.
    """
    (problem, config, seed), clock = planned, options.clock
    until, first = math.inf, None

    def goes_on() -> bool:
        nonlocal until
        if math.isinf(until):  # its planner is built then, which nothing ends
            until = clock() + _STOPPED_SECONDS
        return clock() < until

    if options.earlier is None:
        with computing_on(fitting_device(problem)):
            first = first_policy(problem, config, seed, goes_on)
    left = left_at(stop, first, options.earlier, problem, seed)
    outcome = unjudged_outcome(left, [], problem, seed, clock() - since)
    for judged in outcome.judged:
        options.on_judged(judged)
    return ended_by(outcome, stop)


def _underlying(problem: Problem) -> Problem | None:
    try:
        return underlying_mdp(problem)
    except InputError as error:
        logger.warning("no underlying MDP: %s", one_line_cause(error))
        return None


def _found_nothing(outcome: RaceOutcome) -> bool:
    """Whether the result returns no more than the no-op."""
    found, noop = outcome.chosen.mean, outcome.noop_return
    return found is not None and noop is not None and found <= noop


def _raced(
    underlying: Problem,
    config: PlannerConfig,
    seed: int,
    options: RaceOptions,
    less: Sequence[str],
) -> AnyPolicy | None:
    """What a race for the underlying MDP finds, whose states are not enumerated once more.

    Args:
      underlying: the underlying MDP.
      config: with its time.
      seed: of everything that is drawn.
      options: of the race.
      less: arms that take no part.

    Raises:
      KeyboardInterrupt: if it was interrupted.
    """
    search = read_search(config.sections)
    without = [*(search.without if search else ()), DYNAMIC_PROGRAMMING, *less]
    config = config.with_values(SEARCH, without=without)
    second = RaceOptions(
        options.traced_cache, clock=options.clock, most_iterations=options.most_iterations
    )
    try:
        found = run_race(underlying, config, seed, second)
    except InputError as error:
        logger.warning("no policy of the underlying MDP: %s", one_line_cause(error))
        return None
    if found.interrupted:
        raise KeyboardInterrupt
    return found.policy


def _within(config: PlannerConfig, seconds: float) -> PlannerConfig:
    """The configuration with so much time, or with next to none if nothing is left."""
    return config.with_values("Optimize", train_seconds=max(seconds, _LEAST_SECONDS))
