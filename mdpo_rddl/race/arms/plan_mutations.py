"""Open-loop plans side by side as one array, and the changes that a search for them is made of."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.problem.limits import group_limits
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.race.family import Family
from mdpo_rddl.simulator.simulator import Simulator

REAL, INTEGER, CHOICE, BOOL = range(4)
# how small a change of a number can be, in units
_SMALLEST = 0.01
# of random plans: whether a place is the last that does something, and whether a bool is done
_PLACE, _DONE = 0.3, 0.3
# of a child that has n changes of its kind, whether it has one more
_ONE_MORE = 0.5


class Limit(NamedTuple):
    """How many of some places may be active, which is not at the no-op, or true.

    Attributes:
      group: of each place, -1 for none [D].
      most: of each group [G].
      exact: whether so many must be.
      is_true_at_noop: whether a place is active at the no-op [D].
    """

    group: np.ndarray
    most: np.ndarray
    exact: bool
    is_true_at_noop: np.ndarray


class Genes(NamedTuple):
    """How a step's actions lie in D places of raw numbers, of which 0 is the no-op.

    A real or integer action, or one that is an object, is noop + unit * raw, within its box; a bool
    is not at the no-op if its raw number is 1. That is what a feedback policy makes of its plan.

    Attributes:
      horizon: steps H of a plan.
      places: per action fluent its part of the D places.
      shapes: per action fluent [*shape].
      kind: of each place, `REAL` to `BOOL` [D].
      unit: what a raw 1 means, of each place [D].
      lower, upper: of each place the smallest and largest raw number, perhaps infinite [D].
      part: of each place the number of the object that its action is about [D].
      limits: on what is active in a step.
    """

    horizon: int
    places: Mapping[str, slice]
    shapes: Mapping[str, tuple[int, ...]]
    kind: np.ndarray
    unit: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    part: np.ndarray
    limits: Sequence[Limit]

    @property
    def size(self) -> int:
        """Bytes of a plan."""
        return 4 * self.horizon * len(self.kind)

    def tree(self, plans: np.ndarray) -> dict[str, np.ndarray]:
        """Plans [H, D, ...] per action fluent [H, *shape, ...]."""
        return {
            name: plans[:, which].reshape(len(plans), *self.shapes[name], *plans.shape[2:])
            for name, which in self.places.items()
        }

    def flat(self, raw: Mapping[str, np.ndarray]) -> np.ndarray:
        """Per action fluent [*shape, P], or of several steps [T, *shape, P], as [.., D, P]."""
        columns = [
            each.reshape(*each.shape[: each.ndim - 1 - len(self.shapes[name])], -1, each.shape[-1])
            for name, each in ((name, raw[name]) for name in self.places)
        ]
        return np.concatenate(columns, axis=-2).astype(np.float32)

    def tidied(self, plans: np.ndarray, old: Any = 0.0, random: Any = None) -> np.ndarray:
        """Plans [H, D, P] within boxes and limits, written into.

        Args:
          plans: raw numbers.
          old: what they were made from, with as many axes: where too many are active, changes stay.
          random: numpy's generator, says which of the others.
        """
        if np.any(self.kind == BOOL):
            which = self.kind == BOOL
            plans[:, which] = plans[:, which] > 0.5
        whole = (self.kind == INTEGER) | (self.kind == CHOICE)
        if np.any(whole):
            unit = self.unit[whole, np.newaxis]
            plans[:, whole] = np.rint(plans[:, whole] * unit) / unit
        np.clip(plans, self.lower[:, np.newaxis], self.upper[:, np.newaxis], out=plans)
        for limit in self.limits:
            _keep(limit, plans, old, random or np.random.default_rng(0))
        return plans


def _keep(limit: Limit, plans: np.ndarray, old: Any, random: np.random.Generator) -> None:
    """Makes places active or not until a limit is kept."""
    for group, most in enumerate(limit.most):
        members = np.flatnonzero(limit.group == group)
        base = limit.is_true_at_noop[members, np.newaxis]
        rows = plans[:, members]
        active = (rows != 0) ^ base
        count = active.sum(axis=1)
        steps, which = np.nonzero((count != most) if limit.exact else (count > most))
        if not len(steps):
            continue
        rows, active = rows[steps, :, which], active[steps, :, which]
        before = np.broadcast_to(old, plans.shape)[:, members][steps, :, which]
        is_changed = rows != before
        # what was made active now, what was already, what never was, what was made inactive now
        rank = np.where(active, 2.0 + is_changed, 1.0 - is_changed) + random.random(rows.shape)
        order = np.argsort(-rank, axis=1)
        wanted = np.zeros_like(active)
        np.put_along_axis(wanted, order[:, :most], values=True, axis=1)
        if not limit.exact:
            wanted &= active
        is_other = wanted ^ active
        turned = np.where(rows != 0, 0.0, 1.0)
        plans[steps[:, np.newaxis], members, which[:, np.newaxis]] = np.where(
            is_other, turned, rows
        )


def genes_of(simulator: Simulator, family: Family) -> Genes:
    """How plans of a problem are written.

    Args:
      simulator: of the problem.
      family: whose policies play them.
    """
    model, actions = simulator.problem.model, family.actions
    places, columns, start, parts = dict[str, slice](), [], 0, dict[tuple[str, int], int]()
    for name in simulator.actions:
        shape, noop = simulator.shapes[name], simulator.noop[name].astype(float)
        kind = {"real": REAL, "int": INTEGER, "bool": BOOL}.get(model.variable_ranges[name], CHOICE)
        lower, upper, unit = np.zeros(shape), np.ones(shape), np.ones(shape)
        if kind != BOOL:
            unit = np.broadcast_to(actions.units[name], shape).astype(float)
            lower, upper = (np.broadcast_to(b, shape) for b in actions.bounds[name])
            if kind == INTEGER:
                lower, upper = np.ceil(lower), np.floor(upper)
            lower, upper = (lower - noop) / unit, (upper - noop) / unit
        types = model.variable_params[name]
        first = np.indices(shape)[0].ravel() if shape else np.zeros(1, int)
        part = [parts.setdefault((types[0] if types else "", int(k)), len(parts)) for k in first]
        rows: list[Any] = [np.full(noop.size, kind), noop > 0, unit, lower, upper, part]
        columns.append([np.ravel(row) for row in rows])
        places[name] = slice(start, start + noop.size)
        start += noop.size
    joined = [np.concatenate(each) for each in zip(*columns, strict=True)]
    kinds, is_true, unit_of, lowers, uppers, part_of = joined
    shapes = {name: simulator.shapes[name] for name in simulator.actions}
    limits = _limits(simulator.problem, places, is_true & (kinds == BOOL))
    columns_of = kinds, unit_of, lowers, uppers, part_of
    return Genes(simulator.problem.horizon, places, shapes, *columns_of, limits)


def _limits(problem: Problem, places: Mapping[str, slice], is_true: np.ndarray) -> list[Limit]:
    """The limits of a problem, of whose places some are true at the no-op [D]."""
    model, count = problem.model, len(is_true)
    limits = []
    for each in group_limits(model)[0]:
        group = np.full(count, -1)
        for name, numbers in each.groups.items():
            group[places[name]] = np.ravel(numbers)
        limits.append(Limit(group, each.limits, each.exact, is_true))
    if model.max_allowed_actions < count:
        most = np.array([int(model.max_allowed_actions)])
        limits.append(Limit(np.zeros(count, int), most, False, np.zeros(count, bool)))
    return limits


def random_values(genes: Genes, place: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A raw number for each of some places [N]: on a bound, or anywhere between them."""
    count = len(place)
    ends = [
        np.where(np.isfinite(bound), bound, default)
        for bound, default in ((genes.lower[place], -1.0), (genes.upper[place], 1.0))
    ]
    low, high = np.minimum(*ends), np.maximum(*ends)
    inside = random.uniform(low, high)
    is_bound = (random.random(count) < 0.5) & (genes.kind[place] != CHOICE)
    return np.where(is_bound, np.where(random.random(count) < 0.5, low, high), inside)


def random_plans(genes: Genes, count: int, random: np.random.Generator) -> np.ndarray:
    """Plans [H, D, P] in which some places, often few, hold a value for some steps, then another.

    How long is up to the place: from one step to the horizon. A bool is done now and then.
    """
    horizon, width = genes.horizon, len(genes.kind)
    plans = np.zeros((horizon, width, count), np.float32)
    most = np.minimum(random.geometric(_PLACE, count), width)
    # the first places of a random order
    rank = random.random((width, count)).argsort(axis=0).argsort(axis=0)
    place, plan = np.nonzero(rank < most)
    span = horizon ** random.random(len(place))
    current = np.zeros(len(place))
    for step in range(horizon):
        is_new = random.random(len(place)) * span < 1.0 if step else np.ones(len(place), bool)
        values = random_values(genes, place[is_new], random)
        is_bool = genes.kind[place[is_new]] == BOOL
        current[is_new] = np.where(is_bool, random.random(len(values)) < _DONE, values)
        plans[step, place, plan] = current
    return genes.tidied(plans, 0.0, random)


class Parents(NamedTuple):
    """What children are made from.

    Attributes:
      plans: [H, D, E].
      gains: by what children that were better than their parents differed from them [H, D, G].
      begin: nothing changes before this step.
    """

    plans: np.ndarray
    gains: np.ndarray
    begin: int


KINDS = (
    "set",
    "move",
    "jitter",
    "idle",
    "borrow",
    "delay",
    "delay all",
    "cut",
    "object",
    "toward",
    "gains",
)
"""The changes that `children` knows."""


def children(
    genes: Genes, parents: Parents, kinds: np.ndarray, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Plans that each differ from a parent by changes of one kind.

    Most concern one place in a window of steps, of whatever length: its action is set to a value,
    moved, jittered, not done, taken from another parent, or done some steps earlier or later.
    Others concern all places: all actions are done earlier or later; those after a step, or of one
    object, are another parent's; the plan moves as another parent differs from a third; or some of
    the latest gains are added to it, once or more.

    Args:
      genes: of the plans.
      parents: what they are made from.
      kinds: places in `KINDS`, ascending [P].
      random: numpy's generator.

    Returns:
      The plans [H, D, P], and of each its parent [P].
    """
    count, most = len(kinds), parents.plans.shape[-1]
    parent = random.integers(most, size=count)
    old = parents.plans[:, :, parent]
    plans = old.copy()
    for kind, name in enumerate(KINDS):
        first, last = np.searchsorted(kinds, [kind, kind + 1])
        while first < last:
            now = plans[..., first:last]
            if name in _WHOLE:
                _WHOLE[name](genes, parents, now, random)
            else:
                _change(genes, parents, name, now, random)
            # fewer and fewer have one more change
            last = first + random.binomial(last - first, _ONE_MORE)
    plans[: parents.begin] = old[: parents.begin]
    return genes.tidied(plans, old, random), parent


def _windows(horizon: int, begin: int, count: int, random: np.random.Generator) -> np.ndarray:
    """Masks [H, P] of steps side by side, of whatever length, none before a step."""
    steps = horizon - begin
    length = np.ceil(steps ** random.random(count)).astype(int)
    first = begin + random.integers(1 - length, steps)
    step = np.arange(horizon)[:, np.newaxis]
    return (step >= np.maximum(first, begin)) & (step < first + length)


def _change(
    genes: Genes, parents: Parents, name: str, plans: np.ndarray, random: np.random.Generator
) -> None:
    """One change of one place in a window of each plan, written into."""
    horizon, _, count = plans.shape
    # every fluent is as likely, however many objects it has
    starts, stops = np.array([(each.start, each.stop) for each in genes.places.values()]).T
    fluent = random.integers(len(starts), size=count)
    place, column = random.integers(starts[fluent], stops[fluent]), np.arange(count)
    mask, track = _windows(horizon, parents.begin, count, random), plans[:, place, column]
    is_bool = genes.kind[place] == BOOL
    if name == "set":
        turned = 1.0 - track[mask.argmax(axis=0), column]
        changed = np.where(is_bool, turned, random_values(genes, place, random))
    elif name in ("move", "jitter"):
        shape = (horizon, count) if name == "jitter" else (1, count)
        by = _SMALLEST ** random.random(count) * random.normal(size=shape)
        is_whole = (genes.kind[place] != REAL) & ~is_bool
        least = np.where(is_whole, 1.0 / genes.unit[place], 0.0)
        moved = track + np.sign(by) * np.maximum(np.abs(by), least)
        is_turned = (random.random(shape) < 0.5) | (name == "move")
        changed = np.where(is_bool, np.where(is_turned, 1.0 - track, track), moved)
    elif name == "idle":
        changed = np.zeros_like(track)
    elif name == "borrow":
        changed = parents.plans[:, place, random.integers(parents.plans.shape[-1], size=count)]
    else:
        changed = np.take_along_axis(track, _delayed(mask, random), axis=0)
    plans[:, place, column] = np.where(mask, changed, track)


def _delayed(mask: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Which step [H, P] is done in a step, where those of a window come earlier or later."""
    horizon, count = mask.shape
    first, length = mask.argmax(axis=0), mask.sum(axis=0)
    most = np.ceil(np.maximum(length, 1) ** random.random(count))
    shift = np.where(random.random(count) < 0.5, -most, most).astype(int)
    step = np.arange(horizon)[:, np.newaxis]
    moved = np.clip(step - shift, first, first + np.maximum(length - 1, 0))
    return np.where(mask, moved, step)


def _others(parents: Parents, count: int, random: np.random.Generator) -> np.ndarray:
    """Parents at random [H, D, P]."""
    return parents.plans[..., random.integers(parents.plans.shape[-1], size=count)]


def _delay_all(_: Genes, parents: Parents, plans: np.ndarray, random: np.random.Generator) -> None:
    mask = _windows(len(plans), parents.begin, plans.shape[-1], random)
    plans[...] = np.take_along_axis(plans, _delayed(mask, random)[:, np.newaxis], axis=0)


def _cut(_: Genes, parents: Parents, plans: np.ndarray, random: np.random.Generator) -> None:
    horizon, _width, count = plans.shape
    is_after = np.arange(horizon)[:, np.newaxis] >= random.integers(parents.begin, horizon, count)
    np.copyto(plans, _others(parents, count, random), where=is_after[:, np.newaxis])


def _object(genes: Genes, parents: Parents, plans: np.ndarray, random: np.random.Generator) -> None:
    count = plans.shape[-1]
    part = random.integers(genes.part.max() + 1, size=count)
    is_of = genes.part[:, np.newaxis] == part
    np.copyto(plans, _others(parents, count, random), where=is_of)


def _toward(_: Genes, parents: Parents, plans: np.ndarray, random: np.random.Generator) -> None:
    # differential evolution's, Storn and Price (1997)
    one, two = (_others(parents, plans.shape[-1], random) for _ in range(2))
    plans += (one - two) * random.normal(size=plans.shape[-1])


def _add_gains(_: Genes, parents: Parents, plans: np.ndarray, random: np.random.Generator) -> None:
    count, known = plans.shape[-1], parents.gains.shape[-1]
    if not known:
        return
    # of the first gains, which are the largest, any number, each once or so
    most = np.ceil(known ** random.random(count)).astype(int)
    weight = (np.arange(known)[:, np.newaxis] < most) * 2.0 ** random.normal(size=count)
    weight *= random.random((known, count)) < random.uniform(0.5, 1.5, size=count)
    plans += np.tensordot(parents.gains, weight.astype(np.float32), axes=1)


_WHOLE = {
    "delay all": _delay_all,
    "cut": _cut,
    "object": _object,
    "toward": _toward,
    "gains": _add_gains,
}
