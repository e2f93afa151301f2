"""What a race comes to whose judge has played nothing: stopped early, or compiled too late."""

import contextlib
import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.arms.simple import SIMPLE
from mdpo_rddl.auto.common.arm_log import ArmLog
from mdpo_rddl.auto.common.candidate import NOOP, Candidate, Judged
from mdpo_rddl.auto.common.compilations import TooLateError
from mdpo_rddl.auto.outcome.failures import incumbent_kept
from mdpo_rddl.auto.outcome.outcome import RaceOutcome, policy_of
from mdpo_rddl.auto.outcome.unsearched import found_by_probing, known_by_probing
from mdpo_rddl.auto.resuming.earlier import EarlierRace
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.problem.load import Problem

logger = logging.getLogger(__name__)


class NothingPlayedError(TooLateError):
    """The deadline came before the first rollouts were compiled.

    Attributes:
      noop: the policy that there is without them, not judged.
      log: of what was waited for.
    """

    def __init__(self, noop: Candidate, seconds: float) -> None:
        """Says so.

        Args:
          noop: see the class.
          seconds: that were waited.
        """
        cause = "the time was over before the first program was compiled"
        super().__init__(cause)
        self.noop = noop
        self.log = ArmLog(
            SIMPLE, seconds=seconds, compile_seconds=seconds, details={"cause": cause}
        )


def noop_of(planner: MDPOPlanner, config: PlannerConfig, seed: int) -> Candidate:
    """The no-op as a policy of a planner, not judged.

    Args:
      planner: with a `FeedbackPlan`.
      config: the planner's.
      seed: of the run.
    """
    params = planner.feedback_plan.noop(seed)
    return Candidate(SIMPLE, NOOP, config, planner, params)


def left_at(
    end: BaseException,
    first: Candidate | None,
    earlier: EarlierRace | None,
    problem: Problem,
    seed: int,
) -> Candidate:
    """The policy that there is when a race ends before its arena is there.

    Args:
      end: what has ended it.
      first: what it had before anything was compiled.
      earlier: what an earlier race has left, if this one goes on.
      problem: the parsed problem.
      seed: of the run.

    Raises:
      BaseException: `end`, if somebody has stopped it and there is none; what an earlier race has
        left stays for the next one then.
    """
    if not isinstance(end, NothingPlayedError):
        if first is None:
            raise end
        return first
    if earlier is not None:
        return earlier.incumbent.known(problem, seed)
    return first or end.noop


def unjudged_outcome(
    left: Candidate,
    arms: Sequence[Arm],
    problem: Problem,
    seed: int,
    seconds: float,
) -> RaceOutcome:
    """The outcome of a race that ended while there were arms of the ground model only.

    Args:
      left: the policy that there is beside those of the arms; its return need not be known.
      arms: that have worked.
      problem: the parsed problem.
      seed: of the run.
      seconds: that the race has used.
    """
    found = [left]
    for arm in arms:
        for candidate in arm.take_candidates():
            found.append(candidate)
            arm.judged(candidate)
    best = max(found, key=lambda each: -math.inf if each.mean is None else each.mean)
    return RaceOutcome(
        policy=policy_of(best, problem, seed),
        chosen=best,
        judged=[] if best.mean is None else [Judged(best, seconds, became_incumbent=True)],
        arms=[arm.log for arm in arms],
        probe=None,
        noop_return=next((each.mean for each in found if each.label == NOOP), None),
        random_return=None,
        compile_seconds=0.0,
        seconds=seconds,
        interrupted=False,
    )


def ended_by(outcome: RaceOutcome, end: BaseException) -> RaceOutcome:
    """The outcome with what has ended the race, which one line says, too."""
    if not isinstance(end, NothingPlayedError):
        logger.warning("interrupted: the best policy so far is kept")
        return replace(outcome, interrupted=True)
    told = "" if outcome.judged else ", which nobody has judged"
    logger.warning("%s: the result is %r%s", end, outcome.chosen.label, told)
    seconds = end.log.compile_seconds
    return replace(outcome, arms=[*outcome.arms, end.log], compile_seconds=seconds)


@contextlib.contextmanager
def known_kept(arena: Arena, earlier: EarlierRace | None, early: Sequence[Arm]) -> Iterator[None]:
    """Ends what comes too late for the judge, who takes what others have said of policies then.

    Whatever else has ended early, what the early arms have found is judged.

    Args:
      arena: whose judge has an incumbent afterwards.
      earlier: what an earlier race has left, if this one goes on.
      early: the arms that have worked before anything was compiled.
    """
    found: list[Candidate] = []
    try:
        yield
    except TooLateError as error:
        logger.warning("the best policy so far is kept: %s", error)
        if earlier is None:
            # what comes next may be interrupted
            for candidate in known_by_probing(arena):
                arena.judge.record(candidate)
            with incumbent_kept(arena.judge):
                for candidate in found_by_probing(arena):
                    arena.judge.record(candidate)
        else:
            found.append(earlier.incumbent.known(arena.problem, arena.seed))
    for candidate in found:
        arena.judge.record(candidate)
    record_found(arena.judge, early)


def record_found(judge: Judge, arms: Sequence[Arm]) -> None:
    """Judges what arms have found that know its return, and tells them."""
    for arm in arms:
        for candidate in arm.take_candidates():
            judge.record(candidate)
            arm.judged(judge.judged[-1].candidate)
