"""Planning where the state is observed in part only.

The race looks for a policy that remembers. Then the underlying MDP is planned, and what a belief of
the state elects by its policy is played in the same episodes as the race's policy; the better one
is the result. The underlying policy stays with it, for thinking at the decision.
"""

import contextlib
import dataclasses
import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyRDDLGym.core.debug.exception import RDDLValueOutOfRangeError

from mdpo_rddl.auto.arm_log import ArmLog
from mdpo_rddl.auto.arms.dynamic_programming import DYNAMIC_PROGRAMMING, DynamicProgrammingArm
from mdpo_rddl.auto.arms.relaxed_plans import RELAXED_PLANS
from mdpo_rddl.auto.candidate import Candidate, Judged
from mdpo_rddl.auto.options import RaceOptions
from mdpo_rddl.auto.outcome import RaceOutcome
from mdpo_rddl.auto.race import run_race
from mdpo_rddl.auto.raising import RAISING_SHARE, watched
from mdpo_rddl.errors import Cancelled, InputError, note_heard, one_line_cause
from mdpo_rddl.machine.device import computing_on
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.search_section import SEARCH, read_search
from mdpo_rddl.planner.device import fitting_device
from mdpo_rddl.policy.file import SavedPlanRule, SavedPolicy, SavedTable
from mdpo_rddl.policy.paired_episodes import ERRORS, FEWEST, paired_returns
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.problem.enumeration.discrete import is_discrete
from mdpo_rddl.problem.evaluation import mean_and_error
from mdpo_rddl.problem.load import Problem, make_environment
from mdpo_rddl.problem.underlying import underlying_mdp

logger = logging.getLogger(__name__)

ACTION_VOTING = "action voting"
"""What the part is called that plays by a vote over the belief, and can be left out by."""
_UNDERLYING, _LABEL = "underlying MDP", "vote over the belief"

# of the time, the enumeration of the underlying MDP; where that fails, a race for it, of what is
# then left beside the vote's trial
_OPTIMUM_SHARE, _RACE_SHARE = 0.25, 0.6
# of the time, and the most of it: the vote's compilation, and its and the race's policy's episodes;
# the vote of an optimum is mostly the better one, and has more
_TRIAL_SHARE, _TRIAL_SECONDS = 0.3, 15.0
_LONGER_SHARE, _LONGER_SECONDS = 0.6, 25.0
# what the vote takes to compile, in the times that what plays constants does: a filter and policies
_COMPILING = 1.5
# what the race's policy takes to compile and to play, in the times that the vote took to compile:
# a guess; where that is too long, the vote is compared with what the race says of its policy
_ALONE = 0.75
_STEPS = 3
_LEAST_SECONDS = 0.1
# no seed of a run, nor of the trials of thinking
_SEED = 2**30


@dataclass(frozen=True, eq=False)
class _Trial:
    """The vote in the same episodes as the race's policy, or alone if there was too little time.

    Attributes:
      policy: that votes.
      returns: of both [N, 2], or of the vote [N, 1].
      raced: the race's policy, with what the race says that it returns.
    """

    policy: Policy
    returns: np.ndarray
    raced: Candidate

    @property
    def race_return(self) -> float:
        """What the race's policy returns, on average."""
        known = self.raced.known_mean if self._is_alone else np.mean(self.returns[:, 1])
        return float(known)

    @property
    def pays(self) -> bool:
        """Whether the vote gains enough, in `FEWEST` episodes or more."""
        if self._is_alone:
            mean, spread = mean_and_error(self.returns[:, 0])
            gain, error = mean - self.raced.known_mean, math.hypot(spread, self.raced.error)
        else:
            gain, error = mean_and_error(self.returns[:, 0] - self.returns[:, 1])
        return gain > ERRORS * error

    @property
    def _is_alone(self) -> bool:
        return self.returns.shape[1] == 1


def plan_partially_observed(
    problem: Problem, config: PlannerConfig, seed: int, options: RaceOptions
) -> RaceOutcome:
    """Finds a policy as `run_race` does, and whether a vote over the belief is a better one.

    Where the environment raises an error for some actions, the race has all of the time.

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
    deadline = began + seconds - used
    search = read_search(config.sections)
    watched_until = began + RAISING_SHARE * seconds
    problem = watched(problem, lambda: clock() < watched_until)
    # a vote meets in play what no rollout of the judge's has shown
    is_left_out = problem.raises or (search is not None and ACTION_VOTING in search.without)
    underlying = None if is_left_out else _underlying(problem)
    if underlying is None:
        left = seconds - (clock() - began)
        outcome = run_race(problem, _within(config, left), seed, options)
        return dataclasses.replace(outcome, seconds=clock() - began + used)
    saved: SavedPolicy | SavedTable | None = _optimum(underlying, config, seed, options, deadline)
    is_raced = saved is None
    share, most = (_TRIAL_SHARE, _TRIAL_SECONDS) if is_raced else (_LONGER_SHARE, _LONGER_SECONDS)
    trial = min(share * seconds, most)
    left = seconds - (clock() - began) - trial
    left = (1.0 - _RACE_SHARE) * left if is_raced else left
    # with both judges' programs too late nothing at all would be found
    latest = deadline if is_raced else -math.inf
    patient = dataclasses.replace(options, at_the_latest=latest)
    outcome = run_race(problem, _within(config, left), seed, patient)
    if outcome.interrupted or not isinstance(outcome.policy, Policy):
        return dataclasses.replace(outcome, seconds=clock() - began + used)
    try:
        options.on_stage(_UNDERLYING)
        left = deadline - trial - clock()
        if saved is None and left > 0.0:
            saved = _raced(underlying, _within(config, left), seed, options)
        if saved is not None:
            outcome = _with_vote(outcome, saved, (began - used, deadline), options)
    except (KeyboardInterrupt, Cancelled) as stop:
        note_heard(stop)
        outcome = dataclasses.replace(outcome, interrupted=True)
    return dataclasses.replace(outcome, seconds=clock() - began + used)


def _underlying(problem: Problem) -> Problem | None:
    try:
        return underlying_mdp(problem)
    except InputError as error:
        logger.warning("no underlying MDP: %s", one_line_cause(error))
        return None


def _optimum(
    underlying: Problem, config: PlannerConfig, seed: int, options: RaceOptions, deadline: float
) -> SavedTable | None:
    """The optimum, if the states can be enumerated in a small part of the time.

    The deadline is that of everything, by the clock.
    """
    if not is_discrete(underlying):
        return None
    options.on_stage("enumerating")
    exact = DynamicProgrammingArm(underlying, config, options.clock, keeps_values=True)
    exact.work(min(options.clock() + _OPTIMUM_SHARE * config.budget().seconds, deadline))
    return None if exact.solution is None else exact.solution.policy(seed).to_saved()


def _raced(
    underlying: Problem, config: PlannerConfig, seed: int, options: RaceOptions
) -> SavedPolicy | SavedTable | None:
    """What a race for the underlying MDP finds, whose states are not enumerated once more.

    Raises:
      KeyboardInterrupt: if it was interrupted.
    """
    search = read_search(config.sections)
    # particles follow what is compiled, or looked up
    without = [*(search.without if search else ()), DYNAMIC_PROGRAMMING, RELAXED_PLANS]
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
    saved = found.policy.to_saved()
    assert not isinstance(saved, SavedPlanRule)
    return saved


def _with_vote(
    outcome: RaceOutcome,
    saved: SavedPolicy | SavedTable,
    times: tuple[float, float],
    options: RaceOptions,
) -> RaceOutcome:
    """The race's outcome with the underlying MDP's policy, and the vote if that is better.

    Args:
      outcome: of the race.
      saved: a policy of the underlying MDP.
      times: when all began and is to end, by the clock.
      options: of the race.
    """
    assert isinstance(outcome.policy, Policy)
    clock, log = options.clock, ArmLog(ACTION_VOTING)
    (since, deadline), began = times, clock()
    alone = dataclasses.replace(outcome.policy, saved_underlying=saved)
    outcome = dataclasses.replace(outcome, policy=alone, arms=[*outcome.arms, log])
    probe = outcome.probe
    # where not even the race has compiled anything in time, this takes longer
    compiling = math.inf if probe is None else _COMPILING * probe.compile_seconds
    if began + compiling > deadline:
        log.details = {"cause": "no time"}
        return outcome
    log.slices = 1
    try:
        trial = _tried(alone, outcome.chosen, deadline, log, clock)
    except InputError as error:
        logger.warning("no vote over the belief: %s", one_line_cause(error))
        log.details = {"cause": one_line_cause(error)}
        return outcome
    finally:
        log.seconds = clock() - began
    compiled = outcome.compile_seconds + log.compile_seconds
    outcome = dataclasses.replace(outcome, compile_seconds=compiled)
    log.iterations = len(trial.returns)
    if len(trial.returns) < FEWEST:
        log.details = {"cause": "no time"}
        return outcome
    mean, spread = mean_and_error(trial.returns[:, 0])
    log.best_return = mean
    log.details = {"race_return": trial.race_return}
    # without parameters, it is none that a race may go on from
    named = ACTION_VOTING, _LABEL, outcome.chosen.config, None, None
    chosen = Candidate(*named, mean=mean, error=spread)
    pays = trial.pays
    judged = Judged(chosen, clock() - since, pays)
    options.on_judged(judged)
    outcome = dataclasses.replace(outcome, judged=[*outcome.judged, judged])
    if not pays:
        return outcome
    policy = trial.policy.with_candidates(outcome.curve)
    return dataclasses.replace(outcome, policy=policy, chosen=chosen)


def _tried(
    alone: Policy,
    raced: Candidate,
    deadline: float,
    log: ArmLog,
    clock: Callable[[], float],
) -> _Trial:
    """Plays the vote and the race's policy in the same episodes.

    Where there is too little time for both, the vote alone is played.

    Args:
      alone: the race's policy.
      raced: the same, with what the race says that it returns.
      deadline: no episode is begun that is likely to end later, by the clock.
      log: of the vote.
      clock: tells the seconds.

    Raises:
      InputError: if there can be no vote.
    """
    began = clock()
    with computing_on(fitting_device(alone.problem)):
        voting = dataclasses.replace(alone, votes=True)
        _compile(voting)
        now = clock()
        both = [voting]
        is_known = raced.mean is not None and math.isfinite(raced.error)
        if not is_known or now + _ALONE * (now - began) < deadline:
            _compile(alone)
            both.append(alone)
        log.compile_seconds = clock() - began
        returns = paired_returns(alone.problem, both, deadline, clock, _SEED + alone.seed)
    return _Trial(voting, returns, raced)


def _compile(policy: Policy) -> None:
    """Plays a few steps: what follows an episode is compiled at the second and the third."""
    env = make_environment(policy.problem)
    state: Mapping[str, Any] = env.reset(seed=policy.seed)[0]
    policy.reset()
    # the trial's episodes tell how often it makes the environment raise an error
    with contextlib.suppress(RDDLValueOutOfRangeError):
        for _ in range(_STEPS):
            if not env.done:
                state = env.step(policy.sample_action(state))[0]
    policy.reset()


def _within(config: PlannerConfig, seconds: float) -> PlannerConfig:
    """The configuration with so much time, or with next to none if nothing is left."""
    return config.with_values("Optimize", train_seconds=max(seconds, _LEAST_SECONDS))
