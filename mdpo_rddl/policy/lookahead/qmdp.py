"""Thinking with a policy of the underlying MDP, where the state is observed in part only.

In the rollouts of a decision the particles of the belief play on as if the state were seen from the
next step on: the QMDP method of Littman, Cassandra and Kaelbling, "Learning policies for partially
observable environments: scaling up" (1995), with rollouts of a policy in place of the optimal
values. Nothing is gained there by an action that only informs, so that what it says of its gains is
too much, or too little; episodes on the exact environment tell whether it pays.
"""

import logging
from collections.abc import Callable, Sequence

import numpy as np

from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.policy.lookahead.base import ByPlans, Method, Prepared, Tabled
from mdpo_rddl.policy.lookahead.belief import Believer, known_at
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.simulator import WIDE, Simulator
from mdpo_rddl.policy.lookahead.table_base import TableBase
from mdpo_rddl.policy.lookahead.trials import NO_TIME, Trial
from mdpo_rddl.policy.paired_episodes import ERRORS, FEWEST, paired_returns
from mdpo_rddl.problem.evaluation import mean_and_error
from mdpo_rddl.problem.load import make_environment

logger = logging.getLogger(__name__)

# so many episodes are to be played with thinking and without: decisions are shortened, if they take
# too long, to no less than so many calls beside the filter's time; so that calls are short, they
# are sized for decisions of this share of the time
_WANTED = 12
# decisions take long: so few may make the gain clear
_CLEAR_EPISODES = 5
_SHORTEST_CALLS, _SIZED_FOR = 5.0, 0.25


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
    if FEWEST * least > each:
        return no_time
    short = float(np.clip(each / _WANTED, least, seconds))
    trying = LookaheadPolicy(simulator, method, short, *given)
    both = trying, believer.policy
    returns = paired_returns(policy.problem, both, until, clock, policy.seed, _CLEAR_EPISODES)
    if len(returns) < FEWEST:
        return no_time
    rates = (returns[:, 0] - returns[:, 1]) / simulator.horizon
    found = *mean_and_error(rates), "", len(trying.decisions)
    trial = Trial(thinker.label, *found, beyond=ERRORS)
    return thinker if trial.pays else None, [trial]


def _knowing(believer: Believer) -> Prepared | None:
    """The policy of the underlying MDP, ready for rollouts; None if there is none."""
    try:
        underlying = believer.underlying
        if isinstance(underlying, ByPlans):
            return None  # no compiled rollout can follow it
        return TableBase(underlying) if isinstance(underlying, Tabled) else underlying
    except (InputError, ValueError) as error:
        logger.warning("no policy of the underlying MDP: %s", one_line_cause(error))
        return None
