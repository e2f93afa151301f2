"""Single changes of the no-op, as vectors that a search for a legal action goes through."""

import math
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.planner.plans.places import places_of

# whole numbers and objects of at most so many values are tried one by one
_MOST_VALUES = 8
# below that of any single change
_WHOLE_FLUENT = -2.0


class Changes:
    """An action's components side by side, D of them, as floating-point numbers.

    Attributes:
      size: number of components D.
      noop: the no-op [D].
      is_real: which components are reals [D].
    """

    def __init__(self, compiled: Any) -> None:
        """Lists the changes.

        Args:
          compiled: the exact model as JaxPlan compiles it.
        """
        rddl = compiled.rddl
        self._kinds = {name: rddl.variable_ranges[name] for name in rddl.action_fluents}
        noop = {name: np.asarray(compiled.init_values[name]) for name in self._kinds}
        self._shapes = {name: value.shape for name, value in noop.items()}
        self._parts = places_of(self._shapes)
        self.noop = np.concatenate([np.ravel(noop[n]).astype(np.float32) for n in self._kinds])
        self.size = self.noop.size
        self._widths = np.ones(self.size, np.float32)
        self._is_bool, self.is_real = np.zeros(self.size, bool), np.zeros(self.size, bool)
        places, values = [], []
        for name, part in self._parts.items():
            values_of = choices(compiled, name)
            self._is_bool[part] = self._kinds[name] == "bool"
            self.is_real[part] = self._kinds[name] == "real"
            self._widths[part] = max(1.0, float(np.ptp(values_of))) if len(values_of) else 1.0
            for place in range(part.start, part.stop):
                rest = [value for value in values_of if value != self.noop[place]]
                places += [place] * len(rest)
                values += rest
        self._places, self._values = np.array(places, int), np.array(values, np.float32)

    @property
    def has_numbers(self) -> bool:
        """Whether some action is no bool."""
        return not bool(np.all(self._is_bool))

    def flat(self, actions: Mapping[str, Array]) -> Array:
        """The actions as one vector [D]."""
        return jnp.concatenate(
            [jnp.ravel(jnp.asarray(actions[name], jnp.float32)) for name in self._parts]
        )

    def tree(self, flat: Array, like: Mapping[str, Array]) -> dict[str, Array]:
        """A vector [D] as actions; what equals the actions `like` it has their exact values."""
        actions = {}
        for name, part in self._parts.items():
            value, given = jnp.reshape(flat[part], self._shapes[name]), like[name]
            same = value == given.astype(jnp.float32)
            actions[name] = jnp.where(same, given, value.astype(given.dtype))
        return actions

    def numbers(self, flat: Array) -> dict[str, Array]:
        """A vector [D] per action fluent, as floating-point numbers [*shape]."""
        return {name: jnp.reshape(flat[p], self._shapes[name]) for name, p in self._parts.items()}

    def count(self, flat: Array) -> Array:
        """How many components differ from the no-op."""
        return jnp.sum(flat != self.noop)

    def scores(self, proposed: Array, probabilities: Mapping[str, Array]) -> Array:
        """How much the policy wants to change each component [D], between 0 and 1."""
        likely = [
            jnp.ravel(jnp.asarray(probabilities[name], jnp.float32))
            if kind == "bool"
            else jnp.ones(math.prod(self._shapes[name]), jnp.float32)
            for name, kind in self._kinds.items()
        ]
        true = jnp.concatenate(likely)
        changed = jnp.where(self.noop > 0.5, 1.0 - true, true)
        distance = jnp.minimum(1.0, jnp.abs(proposed - self.noop) / self._widths)
        return jnp.where(self._is_bool, changed, distance)

    def candidates(self, proposed: Array, scores: Array) -> tuple[Array, Array]:
        """The no-op with one change each, then with all bools of a fluent changed.

        Returns:
          The actions [K, D] and their ranks [K].
        """
        one_each = jnp.where(np.eye(self.size, dtype=bool), proposed, self.noop)
        numbers = np.flatnonzero(~self._is_bool)
        rows = np.repeat(self.noop[np.newaxis], len(self._places), axis=0)
        rows[np.arange(len(rows)), self._places] = self._values
        distance = jnp.abs(proposed[self._places] - self._values) / self._widths[self._places]
        ranks = jnp.where(
            self._is_bool[self._places], scores[self._places], 1.0 - jnp.minimum(1.0, distance)
        )
        parts = [part for name, part in self._parts.items() if self._kinds[name] == "bool"]
        wholes = np.repeat(self.noop[np.newaxis], len(parts), axis=0)
        for row, part in zip(wholes, parts, strict=True):
            row[part] = 1.0 - row[part]
        means = [jnp.mean(scores[part]) + _WHOLE_FLUENT for part in parts]
        return (
            jnp.concatenate([one_each[numbers], jnp.asarray(rows), jnp.asarray(wholes)]),
            jnp.concatenate([scores[numbers], ranks, jnp.array(means, jnp.float32)]),
        )


def choices(compiled: Any, name: str) -> list[float]:
    """All values of an action fluent's components, if they are few."""
    kind = compiled.rddl.variable_ranges[name]
    if kind == "bool":
        return [0.0, 1.0]
    if kind == "real":
        return []
    if kind == "int":
        lower, upper = compiled.constraints.bounds[name]
        ends = float(np.ceil(np.min(lower))), float(np.floor(np.max(upper)))
    else:
        ends = 0.0, len(compiled.rddl.type_to_objects[kind]) - 1.0
    if not 0 <= ends[1] - ends[0] < _MOST_VALUES:
        return []
    return np.arange(ends[0], ends[1] + 1.0).tolist()
