"""The vote over the belief: compiled, and played in the same episodes as the race's policy."""

import contextlib
import dataclasses
import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from pyRDDLGym.core.debug.exception import RDDLValueOutOfRangeError

from mdpo_rddl.auto.common.arm_log import ArmLog
from mdpo_rddl.auto.common.candidate import Candidate, Judged
from mdpo_rddl.auto.common.compilations import TooLateError, compiled_within
from mdpo_rddl.auto.outcome.outcome import RaceOutcome, policy_of
from mdpo_rddl.auto.outcome.unjudged import noop_of
from mdpo_rddl.planner.config.fitting import without_scales
from mdpo_rddl.auto.probing.probing import Probe
from mdpo_rddl.auto.race.options import RaceOptions
from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.machine.device import computing_on
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.search_section import SEARCH
from mdpo_rddl.planner.device import fitting_device
from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.policy.paired_episodes import ERRORS, FEWEST, paired_returns
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.policy.relaxed_plan_policy import RelaxedPlanPolicy
from mdpo_rddl.problem.evaluation import LOST, mean_and_error
from mdpo_rddl.problem.load import Problem, make_environment

logger = logging.getLogger(__name__)

ACTION_VOTING = "action voting"
"""What the part is called that plays by a vote over the belief, and can be left out by."""
_LABEL = "vote over the belief"

# what the vote takes to compile, in the times that what plays constants does: a filter and policies
_COMPILING = 1.5
# what the race's policy takes to compile and to play, in the times that the vote took to compile:
# a guess; where that is too long, the vote is compared with what the race says of its policy
_ALONE = 0.75
# of the time left, that the latter is waited for
_WAITING = 0.7
_STEPS = 3
# no seed of a run, nor of the trials of thinking
_SEED = 2**30
_NO_TIME = {"cause": "no time"}


@dataclass(frozen=True, eq=False)
class _Trial:
    """The vote in the same episodes as the race's policy, or alone if there was too little time.

    Attributes:
      returns: of both [N, 2], or of the vote [N, 1].
      raced: the race's policy, with what the race says that it returns.
    """

    returns: np.ndarray
    raced: Candidate

    @property
    def race_return(self) -> float | None:
        """What the race's policy returns, on average; None if nobody knows."""
        return self.raced.mean if self._is_alone else float(np.mean(self.returns[:, 1]))

    @property
    def pays(self) -> bool:
        """Whether the vote gains enough, in `FEWEST` episodes or more."""
        if not self._is_alone:
            gain, error = mean_and_error(self.returns[:, 0] - self.returns[:, 1])
            return gain > ERRORS * error
        mean, spread = mean_and_error(self.returns[:, 0])
        known, error = self.raced.mean, self.raced.error
        # of a no-op that was hardly played nothing else is known
        spread = math.hypot(spread, error) if math.isfinite(error) else spread
        if known is None:
            return bool(np.all(self.returns > LOST))
        return mean - known > ERRORS * spread

    @property
    def _is_alone(self) -> bool:
        return self.returns.shape[1] == 1


class VotingTrial:
    """The vote of an underlying MDP's policy, and whether it returns more than the race's policy.

    Attributes:
      log: what it was given and did.
    """

    def __init__(self, underlying: AnyPolicy, options: RaceOptions) -> None:
        """Compiles nothing yet.

        Args:
          underlying: a policy of the underlying MDP.
          options: of the race.
        """
        self.log = ArmLog(ACTION_VOTING)
        self._underlying = underlying
        self._clock, self._on_judged = options.clock, options.on_judged
        self._voting: Policy | None = None
        # the race's policy, once it can be played
        self._raced: Policy | None = None

    @property
    def is_compiled(self) -> bool:
        """Whether the vote can be played."""
        return self._voting is not None

    def compile_before(
        self, problem: Problem, config: PlannerConfig, seed: int, seconds: float
    ) -> None:
        """Compiles the vote before there is a policy of the race, whose parameters it never reads.

        Args:
          problem: whose state is observed in part only.
          config: of the race.
          seed: of everything that is drawn.
          seconds: how long it is waited for.
        """
        plain = without_scales(config.without_section(SEARCH))

        def noop() -> Policy:
            planner = build_planner(problem, plain).planner
            policy = policy_of(noop_of(planner, plain, seed), problem, seed)
            assert isinstance(policy, Policy)
            return policy

        self._compile(problem, noop, seconds)

    def played(self, outcome: RaceOutcome, since: float, deadline: float) -> RaceOutcome:
        """The race's outcome, able to think with the underlying MDP's policy; the vote if better.

        Args:
          outcome: of a race that was not interrupted.
          since: when everything began, by the clock.
          deadline: no episode is begun that is likely to end later.
        """
        alone = outcome.policy
        assert isinstance(alone, Policy)
        alone = self._knowing(alone)
        if self.log.slices == 0:
            self._compile_beside(alone, outcome.probe, deadline)
        began, trial = self._clock(), None
        try:
            trial = self._tried(alone, outcome.chosen, deadline)
        except Exception as error:  # the race's result is there all the same
            self._give_up(error)
        finally:
            self.log.seconds += self._clock() - began
        outcome = self.unplayed(outcome)
        if self._raced is not None:
            outcome = dataclasses.replace(outcome, policy=self._raced)
        return outcome if trial is None else self._told(outcome, trial, since)

    def unplayed(self, outcome: RaceOutcome) -> RaceOutcome:
        """The race's outcome, able to think with the underlying policy, and the vote's log."""
        assert isinstance(outcome.policy, Policy)
        return dataclasses.replace(
            outcome,
            policy=self._knowing(outcome.policy),
            arms=[*outcome.arms, self.log],
            compile_seconds=outcome.compile_seconds + self.log.compile_seconds,
        )

    def _knowing(self, policy: Policy) -> Policy:
        """The race's policy with the underlying MDP's, if it can think with that."""
        if isinstance(self._underlying, RelaxedPlanPolicy):
            return policy
        return dataclasses.replace(policy, saved_underlying=self._underlying.to_saved())

    def _give_up(self, error: Exception) -> None:
        logger.warning("no vote over the belief: %s", one_line_cause(error))
        self.log.details = {"cause": one_line_cause(error)}

    def _compile_beside(self, alone: Policy, probe: Probe | None, deadline: float) -> None:
        """Compiles the vote with the race's policy, unless it is likely to be too late."""
        # where not even the race has compiled anything in time, this takes longer
        likely = math.inf if probe is None else _COMPILING * probe.compile_seconds
        left = deadline - self._clock()
        if likely > left:
            self.log.details = _NO_TIME
        else:
            self._compile(alone.problem, lambda: alone, left)

    def _compile(self, problem: Problem, policy: Callable[[], Policy], seconds: float) -> None:
        began = self._clock()
        self.log.slices = 1

        def compiled() -> Policy:
            voting = policy().voting_with(self._underlying)
            _play_steps(voting)
            return voting

        try:
            with computing_on(fitting_device(problem)):
                self._voting = compiled_within(seconds, compiled)
        except TooLateError:
            self.log.details = _NO_TIME
        except Exception as error:  # a race needs no vote
            self._give_up(error)
        finally:
            self.log.compile_seconds = self.log.seconds = self._clock() - began

    def _tried(self, alone: Policy, raced: Candidate, deadline: float) -> _Trial | None:
        """Plays the vote and the race's policy in the same episodes; None if in too few.

        Where there is too little time for both, the vote alone is played.
        """
        if self._voting is None:
            return None
        clock, policies = self._clock, [self._voting]
        with computing_on(fitting_device(alone.problem)):
            began = clock()
            is_known = raced.mean is not None and math.isfinite(raced.error)
            if not is_known or began + _ALONE * self.log.compile_seconds < deadline:
                with contextlib.suppress(TooLateError):
                    # what is too late is played on by nobody else
                    own = dataclasses.replace(alone)
                    compiled_within(_WAITING * (deadline - began), lambda: _play_steps(own))
                    self._raced = own
                    policies.append(own)
            self.log.compile_seconds += clock() - began
            returns = paired_returns(alone.problem, policies, deadline, clock, _SEED + alone.seed)
        self.log.iterations = len(returns)
        if len(returns) < FEWEST:
            self.log.details = _NO_TIME
            return None
        return _Trial(returns, raced)

    def _told(self, outcome: RaceOutcome, trial: _Trial, since: float) -> RaceOutcome:
        mean, spread = mean_and_error(trial.returns[:, 0])
        self.log.best_return = mean
        self.log.details = {"race_return": trial.race_return}
        # without parameters, it is none that a race may go on from
        named = ACTION_VOTING, _LABEL, outcome.chosen.config, None, None
        chosen = Candidate(*named, mean=mean, error=spread)
        judged = Judged(chosen, self._clock() - since, trial.pays)
        self._on_judged(judged)
        outcome = dataclasses.replace(outcome, judged=[*outcome.judged, judged])
        if not trial.pays:
            return outcome
        assert isinstance(outcome.policy, Policy)
        assert self._voting is not None
        policy = outcome.policy.voting_as(self._voting).with_candidates(outcome.curve)
        return dataclasses.replace(outcome, policy=policy, chosen=chosen)


def _play_steps(policy: Policy) -> None:
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
