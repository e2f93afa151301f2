"""An action's components side by side: which there are and what they can be."""

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mdpo_rddl.noise.units import in_range_units
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.changes import choices
from mdpo_rddl.planner.plans.places import places_of

# how far whole numbers of many values are changed; larger ones are not exact in single precision
_STEPS, _LARGEST = 2.0 ** np.arange(10), 2.0**24
# nobody tries more joint actions than that, or asks how many more they are
_MOST_COUNTED = 1e6
# of an array of candidates, in single precision
_CANDIDATES_BYTES = 2**25


@dataclass(frozen=True, eq=False)
class Components:
    """The D components of an action, in the order of the action fluents.

    Attributes:
      parts: per action fluent its components.
      values: per component all its values; none where they are many or real.
      is_real: which components are real [D].
      noop: the no-op [D].
      lower, upper: the box of the components whose values are not listed, infinite where there
        is none [D].
      units: what 1 means for each real component: the width of its box or, where there is none,
        the plan's own unit; 0 for the others [D].
      most: so many components may differ from the no-op.
    """

    parts: Mapping[str, slice]
    values: tuple[tuple[float, ...], ...]
    is_real: np.ndarray
    noop: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    units: np.ndarray
    most: int

    @classmethod
    def of(cls, planner: MDPOPlanner) -> "Components":
        """The components of a planner's actions."""
        compiled, rddl = planner.test_compiled, planner.rddl
        noop = {name: np.asarray(compiled.init_values[name]) for name in rddl.action_fluents}
        parts = places_of({name: value.shape for name, value in noop.items()})
        size = sum(value.size for value in noop.values())
        lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
        values: list[tuple[float, ...]] = []
        is_real = np.zeros(size, bool)
        for name, part in parts.items():
            listed, kind = tuple(choices(compiled, name)), rddl.variable_ranges[name]
            values += [listed] * (part.stop - part.start)
            is_real[part] = kind == "real"
            if kind in ("real", "int") and not listed:
                low, high = compiled.constraints.bounds[name]
                lower[part], upper[part] = np.ravel(low), np.ravel(high)
            elif not listed:
                lower[part], upper[part] = 0.0, len(rddl.type_to_objects[kind]) - 1.0
        flat = np.concatenate([np.ravel(value).astype(np.float32) for value in noop.values()])
        most = int(min(rddl.max_allowed_actions, size))
        units = np.where(is_real, _units(planner, parts), 0.0).astype(np.float32)
        return cls(parts, tuple(values), is_real, flat, lower, upper, units, most)

    @property
    def size(self) -> int:
        """Number of components D."""
        return len(self.noop)

    @property
    def discrete(self) -> list[int]:
        """The components whose values can be tried one by one."""
        return [place for place, values in enumerate(self.values) if len(values) > 1]

    @property
    def changeable(self) -> list[int]:
        """The components that are not real."""
        return [place for place in range(self.size) if not self.is_real[place]]

    def near(self, place: int, value: float) -> Sequence[float]:
        """Values of a component that can be tried: all of them or, where they are many, some.

        These are the ends of its box and what is a power of two away.

        Args:
          place: of a component that is not real.
          value: where it is now.
        """
        if self.values[place]:
            return self.values[place]
        ends = np.ceil(self.lower[place]), np.floor(self.upper[place])
        around = np.clip(np.concatenate([value - _STEPS, value + _STEPS]), *ends)
        near = {*around.tolist(), *(float(end) for end in ends if abs(end) < _LARGEST)}
        return sorted(near - {float(value)})

    @property
    def joint_actions(self) -> float:
        """How many joint actions `max-nondef-actions` leaves; infinite for more than a million.

        Infinite also where some values are not listed. Preconditions may allow fewer.
        """
        if not all(self.values):
            return math.inf
        counts = np.zeros(self.most + 1)
        counts[0] = 1.0
        for values in self.values:
            counts[1:] += (len(values) - 1) * counts[:-1]
            # no further component makes them fewer
            if counts.sum() > _MOST_COUNTED:
                return math.inf
        return float(counts.sum())

    def most_candidates(self, depth: int) -> int:
        """How many candidates [k, D] fit into the memory that is meant for them; at least 1.

        Args:
          depth: steps k of a candidate.
        """
        return max(1, _CANDIDATES_BYTES // (4 * depth * max(1, self.size)))

    def changes(self, actions: np.ndarray, base: np.ndarray) -> np.ndarray:
        """How actions [..., D] differ from a base [D], as a later row of a candidate says it.

        What is added to reals, and the number of a listed value, 0 where it is the base's. The
        others count as the base's.
        """
        numbers = np.where(actions != base, 1.0 + actions - self.lowest, 0.0)
        numbers = np.where(self._is_listed, numbers, 0.0)
        return np.where(self.is_real, actions - base, numbers).astype(np.float32)

    def changed(self, changes: np.ndarray, base: np.ndarray) -> np.ndarray:
        """The base [D] with changes [..., D] as `changes` gives them, the reals in their box."""
        real = np.clip(base + changes, self.lower, self.upper)
        listed = self._is_listed & (changes > 0.0)
        actions = np.where(listed, self.lowest + changes - 1.0, base)
        return np.where(self.is_real & (changes != 0.0), real, actions).astype(np.float32)

    @functools.cached_property
    def _is_listed(self) -> np.ndarray:
        return np.array([bool(values) for values in self.values]) & ~self.is_real

    @functools.cached_property
    def lowest(self) -> np.ndarray:
        """The first listed value of each component; 0 where none are listed [D]."""
        lowest = [values[0] if values else 0.0 for values in self.values]
        return np.array(lowest, np.float32)

    def flat(self, action: Mapping[str, Any]) -> np.ndarray:
        """An action as one vector [D]."""
        values = [np.ravel(np.asarray(action[name])).astype(np.float32) for name in self.parts]
        return np.concatenate(values)

    def action(self, flat: np.ndarray, like: Mapping[str, Any]) -> dict[str, Any]:
        """A vector [D] as an action with the shapes and types of another one."""
        chosen = {}
        for name, part in self.parts.items():
            given = np.asarray(like[name])
            chosen[name] = flat[part].reshape(given.shape).astype(given.dtype)
        return chosen


def some(count: int, most: int, random: np.random.Generator) -> list[int]:
    """At most so many of the numbers below `count`, in random order."""
    if count <= 4 * most:
        return random.permutation(count)[:most].tolist()
    return list(dict.fromkeys(random.integers(count, size=most).tolist()))


def _units(planner: MDPOPlanner, parts: Mapping[str, slice]) -> np.ndarray:
    """The unit of each component [D]; 1 where the planner knows none."""
    specs = in_range_units(planner.action_specs, {})
    units = np.ones(max((part.stop for part in parts.values()), default=0))
    for name, part in parts.items():
        if name in specs:
            units[part] = np.ravel(np.broadcast_to(specs[name].unit, specs[name].shape))
    return units
