"""What the ground model solves: exact dynamic programming, and relaxed plans.

Both need a discrete problem whose state is observed. The model is made, enumerated and played
beside the other arms (`mdpo_rddl.race.beside`); here is only received what comes of that.

Dynamic programming (`mdpo_rddl.policy.optimum`) is worth nothing before all steps are done; then
the policy is proven to be the best and the race is over.
"""

import contextlib
import logging
import os
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.policy.plan_rule import PlanRule, Simulated
from mdpo_rddl.policy.relaxed_plan_policy import RelaxedPlanPolicy
from mdpo_rddl.policy.relaxed_plans import RelaxedPlans
from mdpo_rddl.policy.table import ActionTable, Optimum
from mdpo_rddl.policy.table_policy import TablePolicy
from mdpo_rddl.problem.delete_relaxation.distances import Prices
from mdpo_rddl.problem.enumeration.discrete import is_discrete
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, OutOfTimeError
from mdpo_rddl.problem.enumeration.model import open_model
from mdpo_rddl.problem.evaluation import mean_and_error
from mdpo_rddl.race.arm import Arm, Candidate, Context, Turn
from mdpo_rddl.race.beside import Beside, Clock, EndedError
from mdpo_rddl.race.evaluator import Evaluator
from mdpo_rddl.simulator.simulator import Simulator

logger = logging.getLogger(__name__)

DYNAMIC_PROGRAMMING, RELAXED_PLANS = "dynamic programming", "relaxed plans"

# what a process may take: a share of the machine's memory, at most so many bytes
_MEMORY_SHARE, _MOST_MEMORY = 0.25, 4 * 2**30
# rules that are tried, the most different ones first: the second returns -7.9 for the first one's
# -20 on EarthObservation 1 and -100 for -151 on Elevators 5, the first one 9.0 for 7.1 on
# CooperativeRecon 1; of 48 rules none is clearly better than these on any of four problems
_RULES = (
    PlanRule(),
    PlanRule(patience=1.0, prices=Prices(tries=True), searches=True),
    PlanRule(prices=Prices(tries=True), searches=True),
    PlanRule(others=0.2),
)
# episodes of the first rule at most, since few do not show a disaster that is rare, and as many of
# others as seem better
_EPISODES = 128
# of what is left: a rule is given up after the first share, has more episodes till the second
_RULE_SHARE, _MORE_SHARE = 0.5, 0.1

Send = Callable[[Any], None]


class GroundState(NamedTuple):
    """See `mdpo_rddl.race.arm.State`.

    Attributes:
      beside: what works.
      plans: the problem's relaxed plans, once they are there.
    """

    beside: Beside
    found: tuple[Candidate, ...] = ()
    claim: float = -np.inf
    iterations: int = 0
    is_ready: bool = False
    is_exhausted: bool = False
    details: Mapping[str, Any] = {}
    plans: RelaxedPlans | None = None


def dynamic_programming(keeps_values: bool = False) -> Arm:
    """The proven optimum, where the states that are reachable can be enumerated.

    Args:
      keeps_values: whether its table has the states' values, unless they are too many.
    """
    return _arm(DYNAMIC_PROGRAMMING, partial(_prove, keeps_values), _proven)


def relaxed_plans() -> Arm:
    """A relaxed plan at each decision, by the best of a few rules."""
    return _arm(RELAXED_PLANS, _plan, _planned)


def _arm(
    name: str,
    work: Callable[[Context, Send, Clock], None],
    taken: Callable[[Context, GroundState, Any], GroundState],
) -> Arm:
    """An arm that receives what another process finds.

    Args:
      name: of the arm.
      work: what the process does.
      taken: the state with something that it has sent.
    """

    def init(context: Context) -> GroundState | None:
        # a ground model has no laws but those that rewards and states depend on: no others' errors
        if context.problem.raises or not is_discrete(context.problem):
            return None

        def begin(send: Send, clock: Clock) -> None:
            work(context, send, clock)

        return GroundState(Beside(begin, context.budget.clock, _memory()))

    def step(context: Context, state: GroundState, turn: Turn) -> GroundState:
        state = state._replace(found=())
        if state.is_ready:
            try:
                news = state.beside.receive()
            except EndedError as end:
                logger.info("%s: %s", name, end or "ended")
                cause = {"cause": str(end)} if str(end) else {}
                details = {**state.details, **cause}
                return state._replace(is_ready=False, is_exhausted=True, details=details)
            state = taken(context, state, news)
        return state._replace(is_ready=state.beside.has_news())

    return Arm(name, init, step, lambda state: state.beside.close())


def _memory() -> int:
    """Bytes that a process may take."""
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return int(min(_MEMORY_SHARE * machine, _MOST_MEMORY))


# --- relaxed plans -------------------------------------------------------------------------


class _Tried(NamedTuple):
    """A rule, and its returns in the evaluator's episodes [N]; with the first one the plans."""

    rule: PlanRule
    returns: np.ndarray
    plans: RelaxedPlans | None = None


def _plan(context: Context, send: Send, clock: Clock) -> None:
    """Sends each rule that is better than those before it."""
    problem = context.problem
    limits = EnumerationLimits(context.budget.deadline - clock(), clock=clock)
    plans = RelaxedPlans(open_model(problem, limits), limits)
    # one's own, since there may be no process
    evaluator = Evaluator(Simulator(problem), context.seed)
    best: _Tried | None = None
    for rule in _RULES:
        policy = RelaxedPlanPolicy(problem, rule, _NOTHING, context.seed, plans)
        if (tried := _tried(context, evaluator, policy, best, clock)) is not None:
            send(tried if best else tried._replace(plans=plans))
            best = tried
    if best is None:
        raise OutOfTimeError("no rule's first episodes end in time")


def _tried(
    context: Context,
    evaluator: Evaluator,
    policy: RelaxedPlanPolicy,
    best: _Tried | None,
    clock: Clock,
) -> _Tried | None:
    """A rule that is better than the best one; None if it is not, or too slow.

    Where there is none yet it is played as often as its time allows, else as often as the best one,
    unless it is seen to be worse before.
    """
    left, play = context.budget.deadline - clock(), policy.replicated()
    limits = EnumerationLimits(_RULE_SHARE * left, clock=clock)
    most = 1 if context.certain else _EPISODES
    returns, gain, error = np.zeros(0), np.inf, 0.0
    with contextlib.suppress(OutOfTimeError):
        while len(returns) < most:
            returns = evaluator.more(play, returns, limits.check_time)
            if best is None:
                most = most if limits.used < _MORE_SHARE * left else 0
            else:
                gain, error = mean_and_error(returns - best.returns[: len(returns)])
                most = len(best.returns) if gain > 0.0 else 0
    return _Tried(policy.plan_rule, returns) if len(returns) and gain > error else None


def _planned(context: Context, state: GroundState, news: _Tried) -> GroundState:
    plans = news.plans or state.plans
    mean, error = mean_and_error(news.returns)
    claim = Simulated(mean, error, len(news.returns))
    policy = RelaxedPlanPolicy(context.problem, news.rule, claim, context.seed, plans)
    candidate = Candidate(RELAXED_PLANS, RELAXED_PLANS, policy, returns=news.returns)
    state = state._replace(plans=plans, iterations=state.iterations + 1)
    return state._replace(found=(candidate,), claim=mean)


_NOTHING = Simulated(0.0, 0.0, 1)


# --- dynamic programming -------------------------------------------------------------------


class _Solved(NamedTuple):
    """The optimum, and a table that attains it."""

    optimum: Optimum
    table: ActionTable


def _prove(keeps_values: bool, context: Context, send: Send, clock: Clock) -> None:
    """Sends the optimum."""
    seconds = context.budget.deadline - clock()
    found = find_optimum(
        context.problem, seconds, _memory() / 2**30, clock, keeps_values=keeps_values
    )
    send(_Solved(found.optimum, found.table))


def _proven(context: Context, state: GroundState, news: _Solved) -> GroundState:
    policy = TablePolicy(context.problem, news.table, news.optimum, context.seed)
    return state._replace(
        found=(Candidate(DYNAMIC_PROGRAMMING, "proven optimum", policy),),
        claim=news.optimum.value,
        iterations=context.problem.horizon,
        details={"proven": True, "states": news.optimum.states},
    )
