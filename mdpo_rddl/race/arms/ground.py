"""What the ground model solves: exact dynamic programming, and relaxed plans.

Both need a discrete problem whose state is observed. The model is made, enumerated and played
beside the other arms (`mdpo_rddl.race.beside`); here is only received what comes of that.

Dynamic programming is backward induction over the horizon H, with V_H = 0 and discount g:

    V_t(s) = max_a  r(s, a) + g sum_s' P(s' | s, a) V_{t+1}(s')

The sum is worked out once for all states and actions after which the next state is drawn in the
same way. Where all steps are done, the policy is proven to be the best and the race is over; a
part of them is worth nothing.

A state d in which the episode goes on and no action is legal is a dead end. Where it can be avoided
for certain, only actions that do so are looked at. Elsewhere it has a value of its own: with the
least and the largest reward of a legal step, r_min and r_max, and A_t = sum_{k < t} g^k,

    g^t V_t(d) = r_min (A_H - A_t) - (r_max - r_min) (A_H + A_t)

Whatever was collected before, an episode with a dead end is then worth less than the worst legal
one, by the whole range of returns.
"""

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.policy.plan_rule import PlanRule, Simulated
from mdpo_rddl.policy.relaxed_plan_policy import RelaxedPlanPolicy
from mdpo_rddl.policy.relaxed_plans import RelaxedPlans
from mdpo_rddl.policy.table import ActionTable, Optimum
from mdpo_rddl.policy.table_policy import TablePolicy
from mdpo_rddl.problem.delete_relaxation.distances import Prices
from mdpo_rddl.problem.enumeration.discrete import is_discrete
from mdpo_rddl.problem.enumeration.factored import enumerate_factored
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import GroundModel, ground_model, open_model
from mdpo_rddl.problem.enumeration.packing import keys
from mdpo_rddl.problem.enumeration.states import Enumeration, enumerate_states
from mdpo_rddl.problem.evaluation import mean_and_error
from mdpo_rddl.race.arm import Arm, Candidate, Context, Turn
from mdpo_rddl.race.beside import Beside, Clock, EndedError
from mdpo_rddl.race.evaluator import Evaluator
from mdpo_rddl.simulator.evaluation import Replicated
from mdpo_rddl.simulator.simulator import Simulator

logger = logging.getLogger(__name__)

DYNAMIC_PROGRAMMING, RELAXED_PLANS = "dynamic programming", "relaxed plans"

# what a process may take: a share of the machine's memory, at most so many bytes; an enumeration
# takes about as many for each transition
_MEMORY_SHARE, _MOST_MEMORY, _BYTES_PER_TRANSITION = 0.25, 4 * 2**30, 60
# numbers of values that are kept
_MOST_VALUES = 2**24
# a value or a risk that differs by less is the same: rounding
_TIE = 1e-12
# rules that are tried, the most different ones first
_RULES = (
    PlanRule(),
    PlanRule(prices=Prices(tries=True), searches=True),
    PlanRule(prices=Prices(0.97)),
    PlanRule(others=0.2),
)
# episodes of the best rules, where so many take at most such a share of the race: a few do not
# show a disaster that is rare. A rule whose first ones take longer than the share is too slow
_EPISODES, _RULE_SHARE = 128, 0.05
# decisions by which the time of episodes is told: the first ones make what others share
_TIMED = 3

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
    """A rule and its returns in the evaluator's episodes [N]."""

    rule: PlanRule
    returns: np.ndarray


def _plan(context: Context, send: Send, clock: Clock) -> None:
    """Sends relaxed plans, then each rule that is better than those before it."""
    problem, budget = context.problem, context.budget
    limits = EnumerationLimits(budget.deadline - clock(), clock=clock)
    plans = RelaxedPlans(open_model(problem, limits), limits)
    send(plans)
    # one's own, since there may be no process
    evaluator = Evaluator(Simulator(problem), context.seed)
    seconds, best = _RULE_SHARE * budget.seconds, -np.inf
    for rule in _RULES:
        policy = RelaxedPlanPolicy(problem, rule, _NOTHING, context.seed, plans)
        play = _Timed(policy.replicated(), problem.horizon, seconds, clock)
        returns = evaluator.more(play, np.zeros(0), budget.check)
        while returns.mean() > best and len(returns) < _EPISODES and not context.certain:
            if 2.0 * play.used > seconds:
                break
            returns = evaluator.more(play, returns, budget.check)
        if returns.mean() > best:
            best = float(returns.mean())
            send(_Tried(rule, returns))


def _planned(context: Context, state: GroundState, news: Any) -> GroundState:
    if isinstance(news, RelaxedPlans):
        return state._replace(plans=news)
    mean, error = mean_and_error(news.returns)
    claim = Simulated(mean, error, len(news.returns))
    policy = RelaxedPlanPolicy(context.problem, news.rule, claim, context.seed, state.plans)
    candidate = Candidate(RELAXED_PLANS, RELAXED_PLANS, policy, returns=news.returns)
    return state._replace(found=(candidate,), claim=mean, iterations=state.iterations + 1)


_NOTHING = Simulated(0.0, 0.0, 1)


class _Timed:
    """Plays as another one does, until that is seen to take too long.

    Attributes:
      used: seconds of all episodes so far.
    """

    def __init__(self, play: Replicated, horizon: int, seconds: float, clock: Clock) -> None:
        """Has played nothing.

        Args:
          play: decides.
          horizon: decisions of an episode.
          seconds: that episodes side by side may take.
          clock: tells the time.
        """
        self._play, self._horizon, self._seconds, self._clock = play, horizon, seconds, clock
        self._began, self._before = clock(), clock()

    @property
    def used(self) -> float:
        """See the class."""
        return self._clock() - self._began

    def __call__(self, step: int, observation: Mapping[str, np.ndarray]) -> Mapping[str, Any]:
        """As `Replicated`.

        Raises:
          NotEnumerableError: if it takes too long.
        """
        now = self._clock()
        if step == 0:
            self._before = now
        if step >= _TIMED and (now - self._before) * self._horizon > self._seconds * step:
            raise NotEnumerableError(f"a rule's episodes take more than {self._seconds:.2g} s")
        return self._play(step, observation)

    def were_played(self, actions: Mapping[str, np.ndarray]) -> None:
        """Tells it."""
        self._play.were_played(actions)


# --- dynamic programming -------------------------------------------------------------------

_Run = tuple[int, np.ndarray, np.ndarray]
"""A step, states, and the action played in each up to that step."""


class _Solved(NamedTuple):
    """The optimum, a table that attains it, and the probability that it comes to a dead end."""

    optimum: Optimum
    table: ActionTable
    risk: float


def _prove(keeps_values: bool, context: Context, send: Send, clock: Clock) -> None:
    """Sends the optimum."""
    problem, began = context.problem, clock()
    seconds = context.budget.deadline - began
    most = min(EnumerationLimits.transitions, _memory() // _BYTES_PER_TRANSITION)
    limits = EnumerationLimits(seconds, transitions=most, clock=clock)
    model = ground_model(problem, limits)
    try:
        enumeration = enumerate_factored(model, limits)
    except NotEnumerableError as error:
        logger.debug("not factored: %s", error)
        enumeration = enumerate_states(model, limits)
    kept = None
    if keeps_values and len(enumeration.states) * model.horizon <= _MOST_VALUES:
        kept = np.zeros((model.horizon, len(enumeration.states)), np.float32)
    value, risk, runs = _induct(enumeration, limits, kept)
    optimum = Optimum(
        value=value,
        states=len(enumeration.states),
        transitions=enumeration.transitions.nnz,
        actions=len(model.actions),
        seconds=clock() - began,
    )
    send(_Solved(optimum, _table(context, enumeration, runs, kept), risk))


def _proven(context: Context, state: GroundState, news: _Solved) -> GroundState:
    if news.risk > 0.0:
        logger.warning(
            "a state in which no action is legal cannot be avoided: the best policy comes to one "
            "with probability %.3g, which the optimum counts as less than any legal play",
            news.risk,
        )
    policy = TablePolicy(context.problem, news.table, news.optimum, context.seed)
    return state._replace(
        found=(Candidate(DYNAMIC_PROGRAMMING, "proven optimum", policy),),
        claim=news.optimum.value,
        iterations=context.problem.horizon,
        details={"proven": True, "states": news.optimum.states},
    )


def _induct(
    enumeration: Enumeration, limits: EnumerationLimits, kept: np.ndarray | None = None
) -> tuple[float, float, list[_Run]]:
    """The initial state's value and risk, and where the best action changes, the last step first.

    The risk is the probability of coming to a dead end. All states' values at each step are written
    into `kept` [H, S], if that is given.
    """
    model, first, dead = enumeration.model, enumeration.first_row, enumeration.dead
    if dead[0]:
        raise NotEnumerableError("an initial state without a legal action")
    counts = np.diff(first)
    decided = np.flatnonzero(counts)
    starts, counts = first[decided], counts[decided]
    if not len(decided):
        return 0.0, 0.0, []

    def expected(values: np.ndarray) -> np.ndarray:
        # no afterstate is out of range; for "raise" numpy would make another array
        return np.take(enumeration.transitions @ values, enumeration.afterstate, mode="clip")

    values, risk = np.zeros((2, len(dead)))
    best_row, runs = np.full(len(decided), -1), list[_Run]()
    for step in reversed(range(model.horizon)):
        limits.check_time()
        q = expected(values)
        q *= model.discount
        q += enumeration.reward
        if dead.any():
            risks = expected(risk)
            is_safe = risks <= _TIE
            can_be_safe = np.repeat(np.logical_or.reduceat(is_safe, starts), counts)
            q[can_be_safe & ~is_safe] = -np.inf
        best = np.maximum.reduceat(q, starts)
        # rounding shall not change the action from step to step
        enough = best - _TIE * (1.0 + np.abs(best))
        lost = np.flatnonzero((best_row < 0) | ~(q[best_row] >= enough))
        chosen = best_row.copy()
        chosen[lost] = _first_rows(q, enough[lost], starts[lost], counts[lost])
        values[decided] = best
        if dead.any():
            values[dead] = _dead_end_value(enumeration, step)
            risk[decided] = np.where(risks[chosen] <= _TIE, 0.0, risks[chosen])
            risk[dead] = 1.0
        if kept is not None:
            kept[step] = values
        changed = enumeration.action[chosen] != enumeration.action[best_row]
        changed = (changed | (best_row < 0)) & (enumeration.depth[decided] <= step)
        runs.append((step, decided[changed], enumeration.action[chosen[changed]]))
        best_row = chosen
    return float(values[0]), float(risk[0]), runs


def _dead_end_value(enumeration: Enumeration, step: int) -> float:
    """What a state is worth at a step at which an action is due and none is legal."""
    model = enumeration.model
    least, most = float(enumeration.reward.min()), float(enumeration.reward.max())
    # where all steps pay the same, one more of them is lost
    width = most - least or abs(least) or 1.0
    powers = model.discount ** np.arange(model.horizon)
    before, whole = powers[:step].sum(), powers.sum()
    value = least * (whole - before) - width * (whole + before)
    # what later steps pay is rounding
    return float(value / max(model.discount**step, _TIE))


def _first_rows(
    q: np.ndarray, enough: np.ndarray, starts: np.ndarray, counts: np.ndarray
) -> np.ndarray:
    """The first row of each of some states [N] whose value is enough.

    Args:
      q: values of all rows.
      enough: what each state asks for [N].
      starts: the first row of each state [N].
      counts: how many rows it has, at least one [N].
    """
    if not len(starts):
        return starts
    ends = np.cumsum(counts)
    first = ends - counts
    rows = np.arange(ends[-1]) + np.repeat(starts - first, counts)
    found = np.where(q[rows] >= np.repeat(enough, counts), rows, len(q))
    return np.minimum.reduceat(found, first)


def _table(
    context: Context,
    enumeration: Enumeration,
    runs: Sequence[_Run],
    values: np.ndarray | None = None,
) -> ActionTable:
    """The actions of the runs by state and step, and values [H, S]; a state without an action is
    left out."""
    model, states, problem = enumeration.model, enumeration.states, context.problem
    steps = np.repeat([step for step, _, _ in runs], [len(some) for _, some, _ in runs])
    nothing = np.zeros(0, np.int64)
    played_in = np.concatenate([nothing, *(some for _, some, _ in runs)])
    action = np.concatenate([nothing, *(played for _, _, played in runs)])
    used = np.unique(played_in)
    order = used[np.argsort(keys(states[used]))]
    rank = np.zeros(len(states), np.int64)
    rank[order] = np.arange(len(order))
    sequence = np.lexsort((steps, rank[played_in]))
    counts = np.bincount(rank[played_in], minlength=len(order))
    fluents = tuple(dict.fromkeys(name for name, _ in model.variables))
    ranges, objects = problem.model.variable_ranges, problem.model.type_to_objects
    return ActionTable(
        merges=np.array(enumeration.merges, np.uint64).reshape(-1, 3, states.shape[1]),
        places=np.array(model.packing.places, np.int64).reshape(-1, 4),
        states=states[order],
        first_run=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        until_step=steps[sequence].astype(np.int32),
        action=action[sequence].astype(np.int32),
        actions=_action_values(context.simulator, model),
        fluents=fluents,
        objects={n: tuple(objects[ranges[n]]) for n in fluents if ranges[n] in objects},
        values=None if values is None else values[:, order],
    )


def _action_values(simulator: Simulator, model: GroundModel) -> dict[str, np.ndarray]:
    """Per action fluent its values in every joint action [A, *shape]."""
    count, noop = len(model.actions), simulator.noop
    found = {name: np.repeat(v[np.newaxis], count, axis=0) for name, v in noop.items()}
    for number, rules in enumerate(model.actions):
        for (fluent, place), value in rules.assignment.items():
            found[fluent][(number, *place)] = value
    return found
