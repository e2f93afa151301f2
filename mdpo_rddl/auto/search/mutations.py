"""Open-loop plans as arrays, and the mutations that a search for them is made of."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jax import Array

from mdpo_rddl.planner.plans.places import places_of

_MUTATIONS = 0.35
_LONGEST_SHIFT = 5
_SMALLEST_CHANGE = 0.01


@dataclass(frozen=True)
class Layout:
    """How a plan's values for one step lie in a vector of D.

    Attributes:
      shapes: per action fluent the shape of its values, in the order of the vector.
      places: per action fluent its part of the vector.
      is_bool: per place whether it is a bool's [D].
    """

    shapes: Mapping[str, tuple[int, ...]]
    places: Sequence[slice]
    is_bool: np.ndarray

    def tree(self, plans: np.ndarray) -> dict[str, np.ndarray]:
        """Plans [..., D] as values per fluent [..., *shape]."""
        lead = plans.shape[:-1]
        return {
            name: plans[..., places].reshape(lead + shape)
            for (name, shape), places in zip(self.shapes.items(), self.places, strict=True)
        }

    def vector(self, tree: Mapping[str, Array]) -> np.ndarray:
        """One plan's values per fluent [H, *shape] as an array [H, D]."""
        columns = [np.asarray(tree[name]).reshape(len(tree[name]), -1) for name in self.shapes]
        return np.concatenate(columns, axis=1).astype(np.float32)


def layout_of(plan: Mapping[str, Array], bools: Sequence[str]) -> Layout:
    """The layout of one plan.

    Args:
      plan: per action fluent [H, *shape].
      bools: names of those that are bools.
    """
    shapes = {name: tuple(np.shape(values)[1:]) for name, values in plan.items()}
    is_bool = [np.full(math.prod(shape), name in bools) for name, shape in shapes.items()]
    return Layout(shapes, list(places_of(shapes).values()), np.concatenate(is_bool))


def mutants(
    parents: np.ndarray, count: int, layout: Layout, random: np.random.Generator
) -> np.ndarray:
    """Plans that each differ from a parent by one change or a few [count, H, D].

    A change concerns one action of one object over an interval of steps, of whatever length:
    it is set to a value, moved a little, or not done; or it comes from another parent; or
    everything in the plan happens a few steps earlier or later.

    Args:
      parents: raw plans [E, H, D].
      count: number of plans to make.
      layout: of the plans.
      random: generator.
    """
    children = parents[random.integers(len(parents), size=count)]
    which = np.repeat(np.arange(count), random.geometric(_MUTATIONS, size=count))
    changes = _changes(len(which), parents, layout, random)
    for number, change in zip(which.tolist(), changes, strict=True):
        _apply(change, children[number], parents)
    return children


def random_values(is_bool: bool, count: int, random: np.random.Generator) -> np.ndarray:
    """Raw values for one action: a bool's to do it or not, else small ones and bounds."""
    if is_bool:
        return np.where(random.random(count) < 0.7, 1.0, -1.0)
    inside = random.uniform(-1.0, 1.0, count)
    return np.where(random.random(count) < 0.5, inside, np.sign(inside))


class _Change(NamedTuple):
    """One change of a plan.

    Attributes:
      kind: between 0 and 1, says what is done.
      place: of the action in the plan's vectors.
      begin: the first step.
      end: the step after the last one.
      is_bool: whether the action is a bool.
      value: it may be set to.
      move: it may be moved by.
      shift: steps by which what happens may come later.
      other: number of the parent that it may come from.
    """

    kind: float
    place: int
    begin: int
    end: int
    is_bool: bool
    value: float
    move: float
    shift: int
    other: int


def _changes(
    count: int, parents: np.ndarray, layout: Layout, random: np.random.Generator
) -> Iterator[_Change]:
    """Draws changes, all at once: a generator's calls take longer than its numbers."""
    horizon = parents.shape[1]
    # every fluent is as likely, however many objects it has
    starts, stops = np.array([(each.start, each.stop) for each in layout.places]).T
    fluents = random.integers(len(layout.places), size=count)
    places = random.integers(starts[fluents], stops[fluents])
    lengths = np.ceil(horizon ** random.random(count)).astype(int)
    begins = random.integers(1 - lengths, horizon)
    is_bool = layout.is_bool[places]
    values = [random_values(kind, count, random) for kind in (True, False)]
    drawn = (
        random.random(count),
        places,
        np.maximum(begins, 0),
        begins + lengths,
        is_bool,
        np.where(is_bool, *values),
        _SMALLEST_CHANGE ** random.random(count) * random.normal(size=count),
        random.integers(-_LONGEST_SHIFT, _LONGEST_SHIFT + 1, size=count),
        random.integers(len(parents), size=count),
    )
    return map(_Change, *(each.tolist() for each in drawn))


def _apply(change: _Change, plan: np.ndarray, parents: np.ndarray) -> None:
    kind, place, steps = change.kind, change.place, slice(change.begin, change.end)
    if kind < 0.55:
        plan[steps, place] = change.value
    elif kind < 0.75:
        if change.is_bool:
            plan[:, place] = _rolled(plan[:, place], change.shift)
        else:
            plan[steps, place] += change.move
    elif kind < 0.85:
        plan[steps, place] = 0.0
    elif kind < 0.95:
        plan[steps] = _rolled(plan[steps], change.shift)
    else:
        plan[:, place] = parents[change.other, :, place]


def _rolled(values: np.ndarray, shift: int) -> np.ndarray:
    """As `np.roll` along the first axis, which takes several times as long for a plan's few."""
    last = len(values) - shift % max(1, len(values))
    return np.concatenate([values[last:], values[:last]])
