"""The arm that evolves open-loop plans: actions by step, whatever the state."""

import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.problem.evaluation import lost_worth
from mdpo_rddl.race.arm import Arm, Candidate, Context, Judged, Turn
from mdpo_rddl.race.arms.plan_archive import Act, Archive
from mdpo_rddl.race.arms.plan_mutations import (
    KINDS,
    Genes,
    Parents,
    children,
    genes_of,
    random_plans,
)
from mdpo_rddl.race.family import Family
from mdpo_rddl.simulator.common import CommonNumbers
from mdpo_rddl.simulator.rollouts import chosen, rollout
from mdpo_rddl.simulator.simulator import Simulator, State

NAME = "plans"
# episodes of a plan where chance plays a part, and episodes of all plans of an iteration: fewer
# take hardly less time
_EPISODES, _REPLICAS = 8, 1024
_ELITES, _GAINS = 8, 16
# steps of a plan from which its children go on, where chance plays no part
_MARKS = 16
# of the kinds of changes, those drawn whatever they were worth; what of their worth is remembered
_ANY_KIND, _MEMORY = 0.3, 0.9
# iterations of which one explores, once a plan is better than the no-op
_RARELY = 8
# iterations without a gain after which an evolution may have come to its end; the share of all that
# it gained which counts as a gain
_PATIENCE, _LEAST_GAIN = 20, 0.01
_MOST_BYTES = 2**28


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
        return Point(
            {name: value[..., places] for name, value in self.state.items()},
            self.total[places],
            self.is_over[places],
        )

    def beside(self, other: "Point") -> "Point":
        """These episodes, then others."""
        return Point(
            {n: np.concatenate([v, other.state[n]], axis=-1) for n, v in self.state.items()},
            np.concatenate([self.total, other.total]),
            np.concatenate([self.is_over, other.is_over]),
        )


class Played(NamedTuple):
    """What P plans came to.

    Attributes:
      plans: as they were played, without what was not legal [H, D, P]; where chance plays a part as
        they were given.
      returns: [P], the means of their episodes.
      points: by step, where episodes stood.
    """

    plans: np.ndarray
    returns: np.ndarray
    points: Mapping[int, Point]

    def of(self, places: np.ndarray) -> "Played":
        """Of some of the plans."""
        points = {step: point.of(places) for step, point in self.points.items()}
        return Played(self.plans[:, :, places], self.returns[places], points)

    def beside(self, other: "Played") -> "Played":
        """These plans, then others."""
        return Played(
            np.concatenate([self.plans, other.plans], axis=-1),
            np.concatenate([self.returns, other.returns]),
            {step: point.beside(other.points[step]) for step, point in self.points.items()},
        )


class PlansState(NamedTuple):
    """What the arm knows; see `mdpo_rddl.race.arm.State`.

    Attributes:
      genes: how plans are written.
      elites: the best plans of the latest iteration, the very best first.
      gains: see `Parents` [H, D, G].
      wins, tries: of each kind of changes, those that led to an elite, and all [K].
      leader: whose actions were recorded last.
    """

    genes: Genes
    elites: Played | None
    gains: np.ndarray
    wins: np.ndarray
    tries: np.ndarray
    leader: Candidate | None = None
    archive: Archive | None = None
    noop: float = -np.inf
    run: "Run | None" = None
    champions: Played | None = None
    best: Played | None = None
    certain: bool = False
    total: Any = 0
    found: tuple[Candidate, ...] = ()
    claim: float = -np.inf
    iterations: int = 0
    is_ready: bool = True
    is_exhausted: bool = False
    details: Mapping[str, Any] = {}


class Run(NamedTuple):
    """How an evolution from its first plans goes.

    Attributes:
      number: of evolutions before it.
      began: iteration of its first plans.
      gained: iteration of the latest gain that counts.
      first, record: returns of the best of the first plans, and after that gain.
    """

    number: int
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


def acting(family: Family, simulator: Simulator, genes: Genes) -> Act:
    """What policies of a family do whose plan that is: legal actions, as far as there are any."""
    own = {name: {"bias": np.zeros(shape, np.float32)} for name, shape in genes.shapes.items()}
    empty = family.feedback.empty_memory()

    def act(raw: np.ndarray, state: State) -> tuple[Mapping[str, np.ndarray], np.ndarray]:
        params = {"own": own, "plan": genes.tree(raw[np.newaxis])}
        # which a plan does not read
        memory = {
            name: np.broadcast_to(value[..., np.newaxis], (*value.shape, raw.shape[-1]))
            for name, value in empty.items()
        }
        actions = family.play(params, {**simulator.observation(state), **memory}, 0)
        return actions, genes.flat(family.raw(actions)) if family.is_checked else raw

    return act


def play(  # noqa: PLR0913
    context: Context,
    genes: Genes,
    plans: np.ndarray,
    seed: Any,
    episodes: int,
    begin: int = 0,
    point: Point | None = None,
    marks: frozenset[int] = frozenset(),
) -> Played:
    """Plays plans, all of them with the same random numbers.

    Args:
      context: of the race.
      genes: how plans are written.
      plans: raw numbers [H, D, P].
      seed: of the episodes.
      episodes: of each plan.
      begin: the first step that is played.
      point: where the plans stand before it; None for where episodes begin. There is but one
        episode of each then.
      marks: steps before which it is told where they stand; asks for one episode of each.
    """
    simulator, count = context.simulator, plans.shape[-1]
    most = max(1, simulator.block // episodes)
    if count > most:
        parts = []
        for first in range(0, count, most):
            some = np.arange(first, min(first + most, count))
            own = None if point is None else point.of(some)
            parts.append(play(context, genes, plans[..., some], seed, episodes, begin, own, marks))
        return functools.reduce(Played.beside, parts)
    act, replicas = acting(context.family, simulator, genes), count * episodes
    generator = CommonNumbers(np.random.default_rng(seed), np.tile(np.arange(episodes), count))
    if point is None:
        state = simulator.initial(replicas)
        point = Point(state, np.zeros(replicas), simulator.ended(state))
    horizon, discount = genes.horizon, simulator.problem.model.discount
    points: dict[int, Point] = {}
    played = plans.copy()
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


def init(context: Context) -> PlansState | None:
    """Nothing is played yet; None where plans are too large to be evolved."""
    genes = genes_of(context.simulator, context.family)
    size = genes.horizon * len(genes.kind)
    if not size or size * 4 * _ELITES * 2 > _MOST_BYTES:
        return None
    none = np.zeros(len(KINDS))
    gains = np.zeros((genes.horizon, len(genes.kind), 0), np.float32)
    return PlansState(genes, None, gains, none, none, certain=context.certain)


def step(context: Context, state: PlansState, turn: Turn) -> PlansState:
    """Evolves the plans."""
    before = state.best
    while True:
        state = _iterated(context, state, turn)
        context.on_iteration()
        if context.budget.clock() >= turn.until:
            break
    elites = state.best
    assert elites is not None
    assert state.run is not None
    best = elites.plans[:, :, 0]
    details = {"runs": state.run.number + 1}
    if before is not None and np.array_equal(best, before.plans[:, :, 0]):
        return state._replace(found=(), details=details)
    claim = float(elites.returns[0])
    if not context.certain:
        # its return was the best of many
        seed = [context.seed, *NAME.encode(), state.iterations, 1]
        fresh = play(context, state.genes, best[..., np.newaxis], seed, _REPLICAS // 8)
        claim = float(fresh.returns[0])
    found = (candidate(context, state.genes, best),)
    return state._replace(found=found, claim=claim, details=details)


def candidate(context: Context, genes: Genes, plan: np.ndarray) -> Candidate:
    """The policy that plays a plan [H, D]."""
    none = context.family.noop
    return Candidate(
        NAME, NAME, context.family.policy({"own": none["own"], "plan": genes.tree(plan)})
    )


def _population(genes: Genes, episodes: int) -> int:
    """How many plans an iteration tries."""
    size = genes.horizon * len(genes.kind) * 4
    return int(np.clip(_MOST_BYTES // (8 * size), _ELITES, _REPLICAS // episodes))


def _iterated(context: Context, state: PlansState, turn: Turn) -> PlansState:
    genes, simulator = state.genes, context.simulator
    random = context.generator(NAME, state.iterations)
    seed = [context.seed, *NAME.encode(), state.iterations, 0]
    episodes = 1 if context.certain else _EPISODES
    count = _population(genes, episodes)
    marks: frozenset[int] = frozenset()
    if context.certain:
        marks = frozenset(
            np.linspace(0, genes.horizon, _MARKS, endpoint=False).astype(int).tolist()
        )
    newcomers, leader = _recorded(context, state, turn.leader)
    state = state._replace(leader=leader)
    if marks and state.run is not None and state.elites is not None:
        is_nothing = state.elites.returns[0] <= state.noop
        if is_nothing or state.run.is_stale(state.iterations):
            state = _restarted(state)
    elites = state.elites
    often = 1 if state.best is None or state.best.returns[0] <= state.noop else _RARELY
    if state.archive is not None and state.iterations % often == 0:
        newcomers = np.concatenate([newcomers, state.archive.explore(count, random)], axis=-1)
    if elites is None:
        plans = random_plans(genes, count, random)
        plans[:, :, -1] = 0.0
        plans = np.concatenate([newcomers, plans], axis=-1)
        played = play(context, genes, plans, seed, episodes, marks=marks)
        if state.run is None:
            states = [point.state for point in played.points.values()]
            archive = (
                Archive(simulator, genes, acting(context.family, simulator, genes), states)
                if marks
                else None
            )
            state = state._replace(archive=archive, noop=float(played.returns[-1]))
        return _selected(state, played, played.returns[:0], None, None)
    # one in two goes on where the one before began, so that what it gained can be added up
    begins = context.generator(NAME, state.iterations // 2, 2)
    begin = int(begins.choice(sorted(marks))) if marks else 0
    if newcomers.shape[-1]:
        begin = 0
    worth = (state.wins + 1.0) / (state.tries + len(KINDS))
    chances = _ANY_KIND / len(KINDS) + (1.0 - _ANY_KIND) * worth / worth.sum()
    kinds = np.sort(random.choice(len(KINDS), count, p=chances))
    plans, parent = children(genes, Parents(elites.plans, state.gains, begin), kinds, random)
    if marks:
        point = elites.points[begin].of(parent)
        played = play(context, genes, plans, seed, 1, begin, point, marks)
        earlier = {s: p.of(parent) for s, p in elites.points.items() if s < begin}
        played = played._replace(points={**earlier, **played.points})
        if newcomers.shape[-1]:
            played = played.beside(play(context, genes, newcomers, seed, 1, marks=marks))
        played = played.beside(elites)
    else:
        every = np.concatenate([plans, newcomers, elites.plans], axis=-1)
        played = play(context, genes, every, seed, episodes)
    before = played.returns[-elites.plans.shape[-1] :]
    return _selected(state, played, before, kinds, parent)


def _restarted(state: PlansState) -> PlansState:
    """Begins another evolution: with random plans, or, in turn, with what the others have found."""
    assert state.run is not None
    assert state.elites is not None
    number = state.run.number + 1
    champions = state.elites.of(np.arange(1))
    if state.champions is not None:
        champions = champions.beside(state.champions)
        champions = champions.of(_best(champions.returns))
    run = Run(number, state.iterations, state.iterations, np.nan, np.nan)
    elites = champions if number % 3 == 2 else None
    if elites is not None:
        first = float(elites.returns[0])
        run = run._replace(first=first, record=first)
    return state._replace(elites=elites, champions=champions, run=run, gains=state.gains[:, :, :0])


def _selected(
    state: PlansState, played: Played, before: np.ndarray, kinds: Any, parent: Any
) -> PlansState:
    """The best plans of all; a child that is as good as its parent comes first."""
    returns = np.where(np.isnan(played.returns), -np.inf, played.returns)
    chosen = _best(returns)
    elites = played.of(chosen)
    iterations, top = state.iterations + 1, float(elites.returns[0])
    run = state.run
    if run is None:
        run = Run(0, iterations, iterations, top, top)
    elif np.isnan(run.first):
        run = run._replace(first=top, record=top)
    best = state.best
    if best is None or top > best.returns[0] or not state.certain:
        best = elites.of(np.arange(1))
    run = run.after(iterations, top)
    state = state._replace(elites=elites, iterations=iterations, run=run, best=best)
    if kinds is None:
        return state
    count, every = len(kinds), len(KINDS)
    gained = returns[:count] - before[parent]
    led = chosen[(chosen < count)]
    led = led[gained[led] > 0]
    wins = _MEMORY * state.wins + np.bincount(kinds[led], minlength=every)
    tries = _MEMORY * state.tries + np.bincount(kinds, minlength=every) / count * _ELITES
    order = np.argsort(-gained, kind="stable")[:_GAINS]
    order = order[gained[order] > 0]
    old = played.plans[:, :, len(returns) - len(before) :]
    gains = played.plans[:, :, order] - old[:, :, parent[order]]
    return state._replace(
        total=state.total + np.bincount(kinds[led], minlength=every),
        wins=wins,
        tries=tries,
        gains=gains,
    )


def _best(returns: np.ndarray) -> np.ndarray:
    """Places of the best of some returns, the first of those that are equal."""
    _, first = np.unique(-returns, return_index=True)
    return first[:_ELITES]


def _recorded(
    context: Context, state: PlansState, leader: Judged
) -> tuple[np.ndarray, Candidate | None]:
    """What the leader plays, as plans [H, D, P]; none if that is known, or a plan."""
    genes, known = state.genes, leader.candidate
    none = np.zeros((genes.horizon, len(genes.kind), 0), np.float32)
    if known is state.leader or known.arm == NAME:
        return none, state.leader
    policy = known.policy.replicated()
    if policy is None:
        return none, known
    episodes = 1 if context.certain else _EPISODES
    found = rollout(context.simulator, policy, episodes, context.seed, keep=True)
    assert found.trajectories is not None
    moved = {n: np.moveaxis(v, 0, -1) for n, v in found.trajectories.actions.items()}
    raw = {n: np.moveaxis(v, -1, 0) for n, v in context.family.raw(moved).items()}
    plans = genes.flat(raw)
    return genes.tidied(np.pad(plans, [(0, genes.horizon - len(plans)), (0, 0), (0, 0)])), known


def plans() -> Arm:
    """The arm; where plans are not too large to be evolved."""
    return Arm(NAME, init, step)
