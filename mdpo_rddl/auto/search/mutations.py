"""Open-loop plans as arrays, and the mutations that a search for them is made of."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jax import Array

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
    ends = np.cumsum([0, *(math.prod(shape) for shape in shapes.values())]).tolist()
    places = [slice(*pair) for pair in itertools.pairwise(ends)]
    is_bool = [np.full(math.prod(shape), name in bools) for name, shape in shapes.items()]
    return Layout(shapes, places, np.concatenate(is_bool))


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
    for child, changes in zip(children, random.geometric(_MUTATIONS, size=count), strict=True):
        for _ in range(changes):
            _change(child, parents, layout, random)
    return children


def random_values(is_bool: bool, count: int, random: np.random.Generator) -> np.ndarray:
    """Raw values for one action: a bool's to do it or not, else small ones and bounds."""
    if is_bool:
        return np.where(random.random(count) < 0.7, 1.0, -1.0)
    inside = random.uniform(-1.0, 1.0, count)
    return np.where(random.random(count) < 0.5, inside, np.sign(inside))


def _change(
    plan: np.ndarray, parents: np.ndarray, layout: Layout, random: np.random.Generator
) -> None:
    horizon = len(plan)
    # every fluent is as likely, however many objects it has
    places = layout.places[int(random.integers(len(layout.places)))]
    place = int(random.integers(places.start, places.stop))
    length = math.ceil(horizon ** random.random())
    begin = int(random.integers(1 - length, horizon))
    steps = slice(max(begin, 0), begin + length)
    is_bool, kind = layout.is_bool[place], random.random()
    if kind < 0.55:
        plan[steps, place] = random_values(is_bool, 1, random)[0]
    elif kind < 0.75:
        if is_bool:
            plan[:, place] = np.roll(plan[:, place], _shift(random))
        else:
            size = _SMALLEST_CHANGE ** random.random()
            plan[steps, place] += size * random.normal()
    elif kind < 0.85:
        plan[steps, place] = 0.0
    elif kind < 0.95:
        plan[steps] = np.roll(plan[steps], _shift(random), axis=0)
    else:
        plan[:, place] = parents[random.integers(len(parents)), :, place]


def _shift(random: np.random.Generator) -> int:
    return int(random.integers(-_LONGEST_SHIFT, _LONGEST_SHIFT + 1))
