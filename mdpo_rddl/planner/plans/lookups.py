"""Fluents and non-fluents at the objects that a fluent names, such as LOAD(clock).

A fluent whose value is an object, as the hour of a clock or where a bus is, says little as a
number. What is looked up there says what it is about: the load at this hour, who waits at the stop
of each bus.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.planner.plans.features import array_module, observed_fluents

_NUMBERS = ("real", "int", "bool")


class Lookup(NamedTuple):
    """A fluent at objects that another one names.

    Attributes:
      fluent: what is looked up; a non-fluent, too.
      by: the fluent that names objects.
      axis: of the first one's parameters, the one of these objects; the others are those of the
        second one, if there are others.
    """

    fluent: str
    by: str
    axis: int


def lookups(rddl: Any) -> dict[str, Lookup]:
    """All that a policy can look up, found by types alone, by names such as waiting(at(?bus)).

    Looked up are numbers and bools about an object of the type that is named, and about what it is
    named for, as waiting(stop), and limit(bus, stop).

    Args:
      rddl: pyRDDLGym's lifted model.
    """
    seen = observed_fluents(rddl)
    found = {}
    for by in seen:
        kind, own = rddl.variable_ranges[by], list(rddl.variable_params[by])
        for fluent in (*seen, *rddl.non_fluents):
            types = list(rddl.variable_params[fluent])
            if rddl.variable_ranges[fluent] not in _NUMBERS or types.count(kind) != 1:
                continue
            axis = types.index(kind)
            others = types[:axis] + types[axis + 1 :]
            if others and others != own:
                continue
            named = f"{by}({', '.join(f'?{each}' for each in own)})" if own else by
            parts = [f"?{each}" for each in others]
            parts.insert(axis, named)
            found[f"{fluent}({', '.join(parts)})"] = Lookup(fluent, by, axis)
    return found


class Lookups:
    """Some of what a policy can look up, as functions of the state.

    Attributes:
      types: of each of them, those of the objects that it is about.
      shapes: of their values.
    """

    def __init__(self, rddl: Any, values: Mapping[str, Any], names: Sequence[str]) -> None:
        """Finds them.

        Args:
          rddl: pyRDDLGym's lifted model.
          values: per fluent and non-fluent, an array of its shape; read for the non-fluents.
          names: of what is looked up, as `lookups` has them.

        Raises:
          ValueError: for a name that is none of these.
        """
        known = lookups(rddl)
        for name in names:
            if name not in known:
                raise ValueError(f"lookups: there is no {name!r} in this problem")
        self._chosen = {name: known[name] for name in names}
        self.types = {
            name: list(rddl.variable_params[each.by]) for name, each in self._chosen.items()
        }
        self.shapes = {n: tuple(np.shape(values[each.by])) for n, each in self._chosen.items()}
        self._constants = {
            each.fluent: np.asarray(values[each.fluent])
            for each in self._chosen.values()
            if each.fluent in rddl.non_fluents
        }

    def __call__(self, state: Mapping[str, Any], replicas: tuple[int, ...] = ()) -> dict[str, Any]:
        """The values [*shape, *replicas].

        Args:
          state: per observed fluent an array of its shape, of numpy's or JAX's; a relaxed model's
            objects are numbers.
          replicas: how many there are, (B,), if they are a last axis of all these.
        """
        found: dict[str, Any] = {}
        known = {**self._constants, **state}
        for name, (fluent, by, axis) in self._chosen.items():
            values = known[fluent]
            most = values.shape[axis] - 1
            shape = self.shapes[name] + replicas
            places = state[by].reshape(shape).round().clip(0, most).astype(np.int32)
            # of a constant there are no replicas
            trailing = 0 if fluent in self._constants else len(replicas)
            axes = list(np.indices(shape, sparse=True))
            rows = axes[: len(self.shapes[name])] if values.ndim - trailing > 1 else []
            rows.insert(axis, places)
            rows += axes[len(axes) - trailing :]
            # numpy's arrays are no place for what is traced
            found[name] = array_module(places).asarray(values)[tuple(rows)]
        return found
