"""The arm that evolves open-loop plans: actions by step, whatever the state.

In every iteration the best plans and their children meet the same random numbers, new ones each
time, and the best of all stay. Without chance a child is played from the first step on at which it
may differ from its parent; an evolution that gains nothing any more begins again; and as long as no
plan beats the no-op, and now and then after that, an archive of cells is explored, too.
"""

import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.problem.evaluation import lost_worth
from mdpo_rddl.race.arm import Arm, Candidate, Context, Turn
from mdpo_rddl.race.arms.plan_archive import Act, Archive
from mdpo_rddl.race.arms.plan_mutations import (
    KINDS,
    Genes,
    Parents,
    children,
    genes_of,
    random_plans,
)
from mdpo_rddl.simulator.common import CommonNumbers
from mdpo_rddl.simulator.rollouts import chosen, rollout
from mdpo_rddl.simulator.simulator import State

NAME = "plans"

# episodes of a plan where chance plays a part; of all plans of an iteration: with a half or a
# quarter of them RaceCar and UAV returned less after 2 and 5 s, MarsRover 3 and Zombies as much
_EPISODES, _REPLICAS = 8, 1024
# plans that stay (of RaceCar and UAV 32 returned less), and gains that are tried again
_ELITES, _GAINS = 8, 16
# steps from which children go on, where chance plays no part
_MARKS = 16
# of the kinds of changes, those drawn whatever they led to; what of that is remembered
_ANY_KIND, _MEMORY = 0.3, 0.9
# iterations of which one explores, once a plan is better than the no-op
_RARELY = 8
# iterations without a gain after which an evolution may have come to its end; the share of all that
# it gained which counts as a gain
_PATIENCE, _LEAST_GAIN = 20, 0.01
# evolutions of which one begins with what the others have found
_CROSSING = 3
# of an iteration's plans
_MOST_BYTES = 2**26


class Point(NamedTuple):
    """Where P episodes stand before a step.

    Attributes:
      state: [*shape, P].
      total: discounted rewards so far [P].
      is_over: [P].
    """

    state: State
    total: np.ndarray
    is_over: np.ndarray

    def of(self, places: np.ndarray) -> "Point":
        """Of some of the episodes."""
        state = {name: value[..., places] for name, value in self.state.items()}
        return Point(state, self.total[places], self.is_over[places])

    def beside(self, other: "Point") -> "Point":
        """These episodes, then others."""
        state = {
            name: np.concatenate([value, other.state[name]], axis=-1)
            for name, value in self.state.items()
        }
        return Point(state, *map(np.append, self[1:], other[1:]))


class Played(NamedTuple):
    """What P plans came to.

    Attributes:
      plans: [H, D, P]; where chance plays no part, what was played of them.
      returns: means of their episodes [P].
      points: by step, where episodes stood.
    """

    plans: np.ndarray
    returns: np.ndarray
    points: Mapping[int, Point] = {}

    def of(self, places: np.ndarray) -> "Played":
        """Of some of the plans."""
        points = {step: point.of(places) for step, point in self.points.items()}
        return Played(self.plans[..., places], self.returns[places], points)

    def beside(self, other: "Played") -> "Played":
        """These plans, then others."""
        points = {step: point.beside(other.points[step]) for step, point in self.points.items()}
        plans = np.concatenate([self.plans, other.plans], axis=-1)
        return Played(plans, np.append(self.returns, other.returns), points)


class Start(NamedTuple):
    """From where plans are played.

    Attributes:
      step: the first one.
      point: where the plans stand before it; None for where episodes begin.
      marks: steps before which it is kept where they stand.
    """

    step: int = 0
    point: Point | None = None
    marks: frozenset[int] = frozenset()


class Run(NamedTuple):
    """How an evolution goes.

    Attributes:
      began, gained: iterations of its first plans, and of the latest gain that counts.
      first, record: returns of the best of these plans, and after that gain.
    """

    began: int
    gained: int
    first: float
    record: float

    def after(self, iteration: int, best: float) -> "Run":
        """After an iteration."""
        if best > self.record + _LEAST_GAIN * (best - self.first):
            return self._replace(gained=iteration, record=best)
        return self

    def is_stale(self, iteration: int) -> bool:
        """Whether it has gained nothing for as long as it had taken to get there."""
        return iteration - self.gained > max(_PATIENCE, self.gained - self.began)


class PlansState(NamedTuple):
    """See `mdpo_rddl.race.arm.State`.

    Attributes:
      genes: how plans are written.
      gains: see `Parents` [H, D, G].
      elites: the best plans of the latest iteration, the very best first; None before an evolution.
      wins, tries: of each kind of changes, those that led to an elite, and all [K].
      best: the plan that is offered.
      noop: the no-op's return, where chance plays no part.
      run: the evolution that goes on; None before the first.
      champions: the best plans of those before it.
      archive: where plans have led; it grows.
      leader: whose actions were recorded last.
    """

    genes: Genes
    gains: np.ndarray
    elites: Played | None = None
    wins: np.ndarray = np.zeros(len(KINDS))
    tries: np.ndarray = np.zeros(len(KINDS))
    best: Played | None = None
    noop: float = -np.inf
    run: Run | None = None
    champions: Played | None = None
    archive: Archive | None = None
    leader: Candidate | None = None
    found: tuple[Candidate, ...] = ()
    claim: float = -np.inf
    iterations: int = 0
    is_ready: bool = True
    is_exhausted: bool = False
    details: Mapping[str, Any] = {}


def plans() -> Arm:
    """Evolves plans; where they are too large it does not apply."""

    def init(context: Context) -> PlansState | None:
        genes = genes_of(context.simulator, context.family)
        if not 0 < genes.size <= _MOST_BYTES // (2 * _ELITES):
            return None
        return PlansState(genes, np.zeros((genes.horizon, len(genes.kind), 0), np.float32))

    return Arm(NAME, init, _step)


def _step(context: Context, state: PlansState, turn: Turn) -> PlansState:
    """Evolves plans until the turn ends, and offers what is better than before."""
    offered = state.best
    while True:
        state = _iterated(context, state, turn)
        context.on_iteration()
        if context.budget.clock() >= turn.until:
            break
    best = state.best
    if not context.certain:
        # what was the best of many is compared once more
        assert state.elites is not None
        best = state.elites.of(np.arange(1))
        best = best if offered is None else offered.beside(best)
        seed, episodes = _seed(context, state, 1), _REPLICAS // _EPISODES
        fresh = play(context, state.genes, best.plans, seed, episodes)
        best = fresh.of(np.array([np.argmax(fresh.returns)]))
    assert best is not None
    state = state._replace(best=best, claim=float(best.returns[0]), found=())
    if offered is not None and np.array_equal(best.plans, offered.plans):
        return state
    plan, none = state.genes.tree(best.plans[..., 0]), context.family.noop
    policy = context.family.policy({"own": none["own"], "plan": plan})
    return state._replace(found=(Candidate(NAME, "plan", policy),))


def acting(context: Context, genes: Genes) -> Act:
    """What policies do that have nothing but a plan: legal actions, as far as there are any."""
    family, simulator = context.family, context.simulator
    own = {name: {"bias": np.zeros(shape, np.float32)} for name, shape in genes.shapes.items()}
    empty = family.feedback.empty_memory()

    def act(raw: np.ndarray, state: State) -> tuple[Mapping[str, np.ndarray], np.ndarray]:
        context.on_iteration()
        params = {"own": own, "plan": genes.tree(raw[np.newaxis])}
        # a plan does not read it
        memory = {
            name: np.broadcast_to(value[..., np.newaxis], (*value.shape, raw.shape[-1]))
            for name, value in empty.items()
        }
        actions = family.play(params, {**simulator.observation(state), **memory}, 0)
        return actions, genes.flat(family.raw(actions)) if family.is_checked else raw

    return act


def play(
    context: Context,
    genes: Genes,
    plans: np.ndarray,
    seed: Any,
    episodes: int,
    start: Start | None = None,
) -> Played:
    """Plays plans, all of them with the same random numbers.

    Args:
      context: of the race.
      genes: how plans are written.
      plans: raw numbers [H, D, P].
      seed: of the episodes.
      episodes: of each plan.
      start: from where; there is but one episode of each then.
    """
    simulator, count = context.simulator, plans.shape[-1]
    begin, point, marks = start = start or Start()
    most = max(1, simulator.block // episodes)
    if count > most:
        parts = []
        for first in range(0, count, most):
            some = np.arange(first, min(first + most, count))
            own = start._replace(point=None if point is None else point.of(some))
            parts.append(play(context, genes, plans[..., some], seed, episodes, own))
        return functools.reduce(Played.beside, parts)
    which = np.tile(np.arange(episodes), count)
    act, generator = acting(context, genes), CommonNumbers(np.random.default_rng(seed), which)
    if point is None:
        state = simulator.initial(count * episodes)
        point = Point(state, np.zeros(count * episodes), simulator.ended(state))
    horizon, discount = genes.horizon, simulator.problem.model.discount
    played, points = plans.copy(), dict[int, Point]()
    for step in range(begin, horizon):
        if step in marks:
            points[step] = point
        if point.is_over.all():
            break
        actions, raw = act(np.repeat(plans[step], episodes, axis=-1), point.state)
        if episodes == 1:
            played[step] = raw
        after = simulator.step(point.state, actions, generator)
        is_lost = after.errors
        if context.family.is_checked:
            is_lost = is_lost | ~simulator.legal(point.state, actions)
        worth = np.where(is_lost, lost_worth(1.0 - step / horizon), discount**step * after.rewards)
        total = point.total + np.where(point.is_over, 0.0, worth)
        state = chosen(~point.is_over, after.state, point.state)
        point = Point(state, total, point.is_over | is_lost | after.terminated | after.broken)
    points |= {step: point for step in marks if step >= begin and step not in points}
    totals = np.where(np.isfinite(point.total), point.total, -np.inf)
    return Played(played, totals.reshape(count, episodes).mean(axis=1), points)


def _seed(context: Context, state: PlansState, number: int) -> list[int]:
    return [context.seed, *NAME.encode(), state.iterations, number]


def _iterated(context: Context, state: PlansState, turn: Turn) -> PlansState:
    """The next iteration."""
    genes, random = state.genes, np.random.default_rng(_seed(context, state, 0))
    count = _REPLICAS // _episodes(context)
    count = int(np.clip(_MOST_BYTES // genes.size, _ELITES, count))
    state, newcomers = _recorded(context, state, turn.leader.candidate)
    if context.certain and state.run is not None and state.elites is not None:
        is_paid = state.elites.returns[0] > state.noop
        if not is_paid or state.run.is_stale(state.iterations):
            state = _ended(state)
    if state.archive is not None and state.best is not None:
        is_paid = state.best.returns[0] > state.noop
        if not is_paid or state.iterations % _RARELY == 0:
            explored = state.archive.explore(count, random)
            newcomers = np.concatenate([newcomers, explored], axis=-1)
    if state.elites is None:
        return _begun(context, state, newcomers, random_plans(genes, count, random))
    return _bred(context, state, newcomers, count, random)


def _episodes(context: Context) -> int:
    """Of each plan in an iteration."""
    return 1 if context.certain else _EPISODES


def _marks(context: Context, genes: Genes) -> frozenset[int]:
    """Steps from which children may go on."""
    marks = np.linspace(0, genes.horizon, _MARKS, endpoint=False).astype(int)
    return frozenset(marks.tolist() if context.certain else [])


def _begun(
    context: Context, state: PlansState, newcomers: np.ndarray, plans: np.ndarray
) -> PlansState:
    """The first iteration of an evolution."""
    genes = state.genes
    noop = genes.tidied(np.zeros((*plans.shape[:2], 1), np.float32))
    plans = np.concatenate([newcomers, plans, noop], axis=-1)
    start = Start(marks=_marks(context, genes))
    played = play(context, genes, plans, _seed(context, state, 2), _episodes(context), start)
    if state.run is None and context.certain:
        seen = [point.state for point in played.points.values()]
        act, draw = acting(context, genes), functools.partial(random_plans, genes)
        archive = Archive(context.simulator, len(genes.kind), act, draw, seen)
        state = state._replace(archive=archive, noop=float(played.returns[-1]))
    return _selected(state, played, context.certain)


def _bred(
    context: Context,
    state: PlansState,
    newcomers: np.ndarray,
    count: int,
    random: np.random.Generator,
) -> PlansState:
    """An iteration in which elites have so many children."""
    genes, elites, seed = state.genes, state.elites, _seed(context, state, 2)
    assert elites is not None
    marks, begin = _marks(context, genes), 0
    if marks and not newcomers.shape[-1]:
        # one in two begins where the one before did, so that what that gained can be added up
        pair = context.generator(NAME, state.iterations // 2, 3)
        begin = int(pair.choice(sorted(marks)))
    worth = (state.wins + 1.0) / (state.tries + len(KINDS))
    chances = _ANY_KIND / len(KINDS) + (1.0 - _ANY_KIND) * worth / worth.sum()
    kinds = np.sort(random.choice(len(KINDS), count, p=chances))
    plans, parent = children(genes, Parents(elites.plans, state.gains, begin), kinds, random)
    if context.certain:
        start = Start(begin, elites.points[begin].of(parent), marks)
        played = play(context, genes, plans, seed, 1, start)
        earlier = {step: p.of(parent) for step, p in elites.points.items() if step < begin}
        played = played._replace(points={**earlier, **played.points})
        if newcomers.shape[-1]:
            played = played.beside(play(context, genes, newcomers, seed, 1, Start(marks=marks)))
        played = played.beside(elites)
    else:
        plans = np.concatenate([plans, newcomers, elites.plans], axis=-1)
        played = play(context, genes, plans, seed, _EPISODES)
    return _selected(_learnt(state, played, kinds, parent), played, context.certain)


def _learnt(state: PlansState, played: Played, kinds: np.ndarray, parent: np.ndarray) -> PlansState:
    """With what children [P] tell, whose parents are the last of the plans."""
    assert state.elites is not None
    count, first = len(kinds), len(played.returns) - len(state.elites.returns)
    gained = played.returns[:count] - played.returns[first + parent]
    order = np.argsort(-gained, kind="stable")[:_GAINS]
    order = order[gained[order] > 0.0]
    led = _best(played.returns)
    led = led[led < count]
    led = led[gained[led] > 0.0]
    won, tried = (np.bincount(each, minlength=len(KINDS)) for each in (kinds[led], kinds))
    return state._replace(
        wins=_MEMORY * state.wins + won,
        # in units of the elites that all kinds together may lead to
        tries=_MEMORY * state.tries + tried * _ELITES / count,
        gains=played.plans[..., order] - played.plans[..., first + parent[order]],
    )


def _best(returns: np.ndarray) -> np.ndarray:
    """Places of the best returns; of equal ones the first, which is a child's."""
    return np.unique(-returns, return_index=True)[1][:_ELITES]


def _selected(state: PlansState, played: Played, is_certain: bool) -> PlansState:
    """After an iteration in which plans were played."""
    elites, iterations, best = played.of(_best(played.returns)), state.iterations + 1, state.best
    top = float(elites.returns[0])
    if is_certain and (best is None or top > best.returns[0]):
        best = elites.of(np.arange(1))
    run = Run(iterations, iterations, top, top)
    if state.run is not None and state.elites is not None:
        run = state.run.after(iterations, top)
    return state._replace(elites=elites, iterations=iterations, run=run, best=best)


def _ended(state: PlansState) -> PlansState:
    """Before another evolution: from random plans, or, in turn, from what others have found."""
    assert state.elites is not None
    champions, number = state.elites.of(np.arange(1)), state.details.get("evolutions", 0) + 1
    if state.champions is not None:
        champions = champions.beside(state.champions)
        champions = champions.of(_best(champions.returns))
    state = state._replace(champions=champions, gains=state.gains[..., :0])
    state = state._replace(details={"evolutions": number}, elites=None)
    if number % _CROSSING < _CROSSING - 1:
        return state
    now, first = state.iterations, float(champions.returns[0])
    return state._replace(elites=champions, run=Run(now, now, first, first))


def _recorded(
    context: Context, state: PlansState, leader: Candidate
) -> tuple[PlansState, np.ndarray]:
    """What the leader plays, as plans [H, D, P]; none if that is known, or a plan."""
    genes, none = state.genes, state.gains[..., :0]
    if leader is state.leader or leader.arm == NAME:
        return state, none
    state, policy = state._replace(leader=leader), leader.policy.replicated()
    if policy is None:
        return state, none

    def watched(step: int, observation: Mapping[str, np.ndarray]) -> Mapping[str, Any]:
        context.on_iteration()
        actions = policy(step, observation)
        if hasattr(policy, "were_played"):
            policy.were_played(actions)
        return actions

    given = _episodes(context), context.seed
    found = rollout(context.simulator, watched, *given, keep=True).trajectories
    assert found is not None
    moved = {name: np.moveaxis(each, 0, -1) for name, each in found.actions.items()}
    raw = {name: np.moveaxis(v, -1, 0) for name, v in context.family.raw(moved).items()}
    plans = genes.flat(raw)
    rest = [(0, genes.horizon - len(plans)), (0, 0), (0, 0)]
    return state, genes.tidied(np.pad(plans, rest))
