"""Thinking with a policy of the underlying MDP, where the state is observed in part only.

In the rollouts of a decision the particles of the belief play on as if the state were seen from the
next step on: the QMDP method of Littman, Cassandra and Kaelbling, "Learning policies for partially
observable environments: scaling up" (1995), with rollouts of a policy in place of the optimal
values. Nothing is gained there by an action that only informs, so that what it says of its gains is
too much, or too little; episodes on the exact environment tell whether it pays.
"""

import logging
import math
from collections.abc import Callable, Sequence

import numpy as np

from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.policy.lookahead.base import Method, Prepared, Tabled
from mdpo_rddl.policy.lookahead.belief import Believer, known_at
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.simulator import WIDE, Simulator
from mdpo_rddl.policy.lookahead.table_base import TableBase
from mdpo_rddl.policy.lookahead.trials import NO_TIME, Trial
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment

logger = logging.getLogger(__name__)

# episodes that are played with thinking and without
_FEWEST, _WANTED, _MOST = 3, 12, 40
# decisions are shortened, if so many episodes take too long, to no less than so many calls beside
# the filter's time; so that calls are short, they are sized for decisions of this share of the time
_SHORTEST_CALLS, _SIZED_FOR = 5.0, 0.25
# the gain must be so many errors: decisions in play are longer and gain more, and the error of a
# few episodes hides gains worth having
_ERRORS = 0.5
# no more are played, after so many, once the gain is so many errors
_CLEAR, _CLEAR_EPISODES = 4.0, 5
# no episode of an evaluation
_STREAM = 2**31


def try_qmdp(
    believer: Believer,
    methods: Sequence[Method],
    times: tuple[float, float],
    clock: Callable[[], float],
) -> tuple[LookaheadPolicy | None, list[Trial]]:
    """Thinks with the policy of the underlying MDP, if that pays in episodes.

    Args:
      believer: of a policy that may have one of the underlying MDP.
      methods: that apply; the first one that changes the first action alone is taken.
      times: seconds of a decision, and when the trial is to end.
      clock: tells the seconds.

    Returns:
      What thinks, None where that does not pay; and the trial, if there is such a policy and such
      a method.
    """
    single = [method for method in methods if method.depth == 1]
    knowing = _knowing(believer) if single else None
    if knowing is None:
        return None, []
    seconds, until = times
    method, policy = single[0], believer.continued_by(knowing)
    simulator = Simulator(policy, method.depth, clock)
    given = policy.seed, clock
    thinker = LookaheadPolicy(simulator, method, seconds, *given)
    no_time = None, [Trial(thinker.label, None, None, NO_TIME)]
    start = known_at(policy, 0, make_environment(policy.problem).reset(seed=policy.seed)[0])
    if clock() >= until or not simulator.prepare(start, _SIZED_FOR * seconds, until):
        return no_time
    each = (until - clock()) / simulator.horizon
    least = policy.filter_seconds + _SHORTEST_CALLS * simulator.seconds(WIDE, 0)
    least = min(least, seconds)
    if _FEWEST * least > each:
        return no_time
    short = float(np.clip(each / _WANTED, least, seconds))
    trying = LookaheadPolicy(simulator, method, short, *given)
    gains = _gains(trying, believer.policy, until, clock)
    if len(gains) < _FEWEST:
        return no_time
    rates = gains / simulator.horizon
    error = float(np.std(rates, ddof=1) / math.sqrt(len(rates)))
    found = float(np.mean(rates)), error, "", len(trying.decisions)
    trial = Trial(thinker.label, *found, beyond=_ERRORS)
    return thinker if trial.pays else None, [trial]


def _knowing(believer: Believer) -> Prepared | None:
    """The policy of the underlying MDP, ready for rollouts; None if there is none."""
    try:
        underlying = believer.underlying
        return TableBase(underlying) if isinstance(underlying, Tabled) else underlying
    except (InputError, ValueError) as error:
        logger.warning("no policy of the underlying MDP: %s", one_line_cause(error))
        return None


def _gains(
    trying: LookaheadPolicy, alone: Prepared, until: float, clock: Callable[[], float]
) -> np.ndarray:
    """What episodes return more with thinking than without [N]."""
    gains: list[float] = []
    longest, before = 0.0, clock()
    env = make_environment(trying.problem)
    while len(gains) < _MOST and before + longest <= until and not _is_clear(gains):
        # an episode of its own each time, the same for both
        seed = (_STREAM + alone.seed) * _MOST + len(gains)
        returns = [evaluate(env, policy, 1, seed).mean for policy in (trying, alone)]
        gains.append(returns[0] - returns[1])
        now = clock()
        longest, before = max(longest, now - before), now
    return np.array(gains)


def _is_clear(gains: Sequence[float]) -> bool:
    if len(gains) < _CLEAR_EPISODES:
        return False
    error = np.std(gains, ddof=1) / math.sqrt(len(gains))
    return bool(abs(np.mean(gains)) > _CLEAR * error)
