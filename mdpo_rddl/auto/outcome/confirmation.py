"""Whether the exact environment pays what the judge's rollouts have promised.

Both play by the same rules, the environment in 64 bit. Where a rule has a threshold, as a least
production above which a plant counts as on, a policy may be found that sits exactly on it, and
rounding then decides.
"""

import contextlib
import logging
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from pyRDDLGym.core.debug.exception import RDDLValueOutOfRangeError

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.compilations import TooLateError, compiled_within
from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.auto.outcome.outcome import policy_of
from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.problem.episode import WatchedPolicy
from mdpo_rddl.problem.evaluation import LOST, Evaluation, evaluate, mean_and_error
from mdpo_rddl.problem.load import Problem, make_environment

logger = logging.getLogger(__name__)

Play = Callable[[Candidate], Evaluation]
"""Plays a candidate on the exact environment, the same episodes each time."""

# of the difference's standard error, and of the return
_ERRORS, _SHARE = 4.0, 0.01
# fewer do not tell their own error
_FEWEST_EPISODES, _EPISODES = 5, 10
# what plays one step compiles in less than so much of the time that the judge's rollouts take
_COMPILATION = 0.4
# makes the episodes none of those of an evaluation with the race's seed
_STREAM = 1


def confirm(arena: Arena, until: float, latest: float) -> Candidate:
    """The race's result, which the exact environment has been played with if there was time.

    Args:
      arena: whose judge has an incumbent.
      until: when no further episode begins, by the clock, after the fewest that tell anything.
      latest: when to end in any case.
    """
    clock, judge = arena.clock, arena.judge
    play = episodes_of(arena.problem, arena.seed, (until, latest), clock)
    longest = _COMPILATION * judge.usual_seconds
    chosen = confirmed(judge, play, lambda: clock() + longest < latest)
    if chosen is not judge.incumbent:
        judge.lead(chosen)
    return chosen


def confirmed(judge: Judge, play: Play, has_time: Callable[[], bool]) -> Candidate:
    """The incumbent; another arm's best where the environment pays it less than it has promised.

    The other one must itself be paid what it has promised, and return more in the same episodes.

    Args:
      judge: has an incumbent.
      play: gives the returns of a candidate; a `TooLateError` of its ends the search for another.
      has_time: whether another candidate may be played.
    """
    chosen = judge.incumbent
    assert chosen is not None
    if chosen.returns is None or not has_time():
        return chosen
    with contextlib.suppress(TooLateError):
        played = play(chosen)
        if len(played.returns) < _FEWEST_EPISODES or not is_less(chosen, played):
            return chosen
        for rival in _rivals(judge, chosen):
            if not has_time():
                break
            its = play(rival)
            if _is_clearly_better(its, played) and not is_less(rival, its):
                told = "%s; %r is the result, to which it paid %.6g"
                logger.warning(told, less_than_judged(chosen, played), rival.label, its.mean)
                return rival
    return chosen


def _rivals(judge: Judge, chosen: Candidate) -> list[Candidate]:
    """The other arms' best policies of which rollouts were made, the best first."""
    bests: dict[str, Candidate] = {}
    for one in (judged.candidate for judged in judge.judged):
        if one.arm == chosen.arm or one.params is None or one.returns is None:
            continue
        if one.arm not in bests or one.known_mean > bests[one.arm].known_mean:
            bests[one.arm] = one
    return sorted(bests.values(), key=lambda each: each.known_mean, reverse=True)


def _is_clearly_better(one: Evaluation, other: Evaluation) -> bool:
    """Whether one returns more in the episodes that both have, beyond the errors."""
    common = min(len(one.worth), len(other.worth))
    if common < _FEWEST_EPISODES:
        return False
    gain, error = mean_and_error(one.worth[:common] - other.worth[:common])
    return gain > _ERRORS * error


def episodes_of(problem: Problem, seed: int, ends: tuple[float, float], clock: Clock) -> Play:
    """Plays candidates in the same episodes, as many of them as there is time for.

    Where one makes the environment raise an error, all its episodes count as `LOST`.

    Args:
      problem: the parsed problem.
      seed: of the race.
      ends: when no further episode begins, by the clock, after the fewest that tell anything; when
        to end with a `TooLateError`.
      clock: of the race.
    """
    env = make_environment(problem)
    until, latest = ends
    stream = int(np.random.SeedSequence([seed, _STREAM]).generate_state(1)[0])

    def play(candidate: Candidate) -> Evaluation:
        policy, ended, is_compiled = policy_of(candidate, problem, seed), 0, False

        def decide(step: int, state: Any) -> Any:
            nonlocal is_compiled
            left = latest - clock()
            if left <= 0.0:
                raise TooLateError("the result's episodes on the environment take too long")
            if is_compiled:
                return policy(step, state)
            # beside an arm's program, which nothing interrupts either, this takes long
            actions = compiled_within(left, lambda: policy(step, state))
            is_compiled = True
            return actions

        def goes_on() -> bool:
            nonlocal ended
            ended += 1
            return ended < _FEWEST_EPISODES or clock() < until

        try:
            return evaluate(env, WatchedPolicy(policy, decide), _EPISODES, stream, goes_on)
        except RDDLValueOutOfRangeError as error:
            logger.info("the environment fails: %s", one_line_cause(error))
            lost, lengths = np.full(_FEWEST_EPISODES, LOST), np.ones(_FEWEST_EPISODES, int)
            return Evaluation(lost, lengths, illegal_actions=0, fallback_actions=0)

    return play


def is_less(chosen: Candidate, played: Evaluation) -> bool:
    """Whether the environment has paid less than the judge's rollouts, beyond their errors.

    Args:
      chosen: a candidate; False of one that no rollouts were made of.
      played: its episodes on the exact environment; False of a single one.
    """
    count = len(played.returns)
    if count < 2 or chosen.returns is None or chosen.mean is None:
        return False
    mean, error = mean_and_error(played.worth)
    least = _ERRORS * math.hypot(error, chosen.error) + _SHARE * abs(chosen.mean)
    return bool(mean < chosen.mean - least)


def less_than_judged(chosen: Candidate, played: Evaluation) -> str:
    """What is said where `is_less`; empty elsewhere."""
    if not is_less(chosen, played):
        return ""
    return (
        f"the exact environment paid {played.mean:,.6g} where the judge's rollouts had "
        f"{chosen.mean:,.6g}: the policy may sit on a threshold, where rounding decides"
    )
