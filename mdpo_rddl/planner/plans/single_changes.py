"""Single changes of the no-op where each action has few values, as a vector of bools."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

Actions = Mapping[str, Array]

# of a component of an action
_MOST_VALUES = 64


class Choice(NamedTuple):
    """What one action fluent may be beside its no-op.

    Attributes:
      noop: its values [*shape].
      others: the other values of each component [*shape, K]; the no-op's where it has fewer.
    """

    noop: np.ndarray
    others: np.ndarray


class SingleChanges:
    """D changes of the no-op: of one component each, a bool's to its other value, a number's or an
    object's to one of its other values.

    Attributes:
      size: how many, D.
      noop: per action fluent its value [*shape].
      numbers: the action fluents that are no bools.
    """

    def __init__(self, choices: Mapping[str, Choice]) -> None:
        """Lists them, of each component side by side.

        Args:
          choices: per action fluent.
        """
        self._choices = dict(choices)
        self.noop = {name: choice.noop for name, choice in choices.items()}
        self.size = sum(choice.others.size for choice in choices.values())
        self.numbers = [name for name, value in self.noop.items() if value.dtype != bool]

    @classmethod
    def of(cls, compiled: Any) -> "SingleChanges | None":
        """Those of a model; None if an action is real, or has more than 64 values or no bounds.

        Args:
          compiled: the exact model as JaxPlan compiles it.
        """
        found = {name: _choice(compiled, name) for name in compiled.rddl.action_fluents}
        known = {name: choice for name, choice in found.items() if choice is not None}
        return cls(known) if len(known) == len(found) else None

    @property
    def places(self) -> np.ndarray:
        """Where each component's changes are [C, K]; D, which is nowhere, where it has fewer."""
        rows, start = [], 0
        most = max(choice.others.shape[-1] for choice in self._choices.values())
        for choice in self._choices.values():
            own = start + np.arange(choice.others.size).reshape(-1, choice.others.shape[-1])
            rows.append(np.pad(own, ((0, 0), (0, most - own.shape[1])), constant_values=self.size))
            start += choice.others.size
        return np.concatenate(rows)

    def split(self, flat: Array) -> dict[str, Array]:
        """A vector [D] per action fluent [*shape, K]."""
        tree, start = {}, 0
        for name, choice in self._choices.items():
            end = start + choice.others.size
            tree[name] = jnp.reshape(flat[start:end], choice.others.shape)
            start = end
        return tree

    def made(self, leaving: Array) -> dict[str, Array]:
        """The no-op with these changes [D], of which no two are of the same component."""
        return {name: self._value(name, left) for name, left in self.split(leaving).items()}

    def best(self, gains: Array) -> tuple[dict[str, Array], dict[str, Array]]:
        """Of each component the change that gains most, whether or not it gains anything.

        Args:
          gains: of the changes [D].

        Returns:
          What it gains and the value that it leads to, per action fluent [*shape].
        """
        most, values = {}, {}
        for name, own in self.split(gains).items():
            is_best = jnp.argmax(own, axis=-1)[..., jnp.newaxis] == np.arange(own.shape[-1])
            most[name], values[name] = jnp.max(own, axis=-1), self._value(name, is_best)
        return most, values

    def like(self, proposed: Actions) -> Array:
        """What would be gains [D] for a policy that prefers the changes in their order.

        Args:
          proposed: per action fluent [*shape]: of bools the log-odds of not being at the no-op;
            of others numbers, and what is nearer to them than the no-op would gain.
        """
        return jnp.concatenate([self._gained(name, proposed[name]) for name in self._choices])

    def _gained(self, name: str, proposed: Array) -> Array:
        noop, others = self._choices[name]
        if noop.dtype == bool:
            return jnp.ravel(proposed)
        wanted = proposed[..., jnp.newaxis]
        return jnp.ravel(jnp.abs(noop[..., np.newaxis] - wanted) - jnp.abs(others - wanted))

    def _value(self, name: str, left: Array) -> Array:
        noop, others = self._choices[name]
        if noop.dtype == bool:
            return left[..., 0] ^ noop
        moved = jnp.sum(jnp.where(left, others - noop[..., np.newaxis], 0), axis=-1)
        return jnp.asarray(noop + moved, noop.dtype)


def _choice(compiled: Any, name: str) -> Choice | None:
    """Of one action fluent; None if its values are not few."""
    rddl, kind = compiled.rddl, compiled.rddl.variable_ranges[name]
    noop = np.asarray(compiled.init_values[name])
    if kind == "bool":
        noop = noop.astype(bool)
        return Choice(noop, ~noop[..., np.newaxis])
    if kind == "real":
        return None
    if kind == "int":
        ends = compiled.constraints.bounds[name]
    else:
        ends = 0.0, len(rddl.type_to_objects[kind]) - 1.0
    lower, upper = (np.broadcast_to(np.asarray(end, float), noop.shape) for end in ends)
    if not np.all(upper - lower < _MOST_VALUES):
        return None  # infinite ones, too
    boxes = zip(np.ceil(lower).flat, np.floor(upper).flat, strict=True)
    each = [_others(*pair) for pair in zip(boxes, noop.flat, strict=True)]
    most = max(1, *map(len, each))
    filled = [
        [*values, *[at] * (most - len(values))] for values, at in zip(each, noop.flat, strict=True)
    ]
    values = np.array(filled, compiled.INT).reshape(*noop.shape, most)
    return Choice(noop.astype(compiled.INT), values)


def _others(box: tuple[float, float], noop: Any) -> Sequence[float]:
    return [value for value in np.arange(box[0], box[1] + 1.0) if value != noop]
