"""What a policy is expected to return from a state on: a small net on the ground state."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, random

Weights = dict[str, Array]

# larger ones have products of thousands of inputs, which are left out
_MOST_INPUTS = 2048
_LARGEST_INPUT = 5.0
# how many inputs are on at a time, about
_FEW = 4.0
_MOST_UNITS = 1024


@dataclass(frozen=True)
class ValueShape:
    """What a value is made of.

    Attributes:
      units: of the hidden layer.
      state_scales: per fluent that is no bool its centre and scale; (0, 1) where it is not named.

    Raises:
      ValueError: if `units` is no such number.
    """

    units: int = 128
    state_scales: Mapping[str, Sequence[float]] | None = None

    def __post_init__(self) -> None:
        is_count = isinstance(self.units, int) and not isinstance(self.units, bool)
        if not (is_count and 1 <= self.units <= _MOST_UNITS):
            raise ValueError(
                f"units: must be a whole number from 1 to {_MOST_UNITS}, got {self.units!r}"
            )


class StateValues:
    """The value of a state x with a share l of the steps left, a hidden layer beside a line:

        v(x, l) = x . (w + l w') + relu(x H + b + l b') . (o + l o').

    x are the ground state fluents, for those whose values are objects whether it is each of these,
    and the products of two of them that are about the same objects, f(a) g(a, b): where something
    is and what is there as well. What is left of the horizon matters for those that end it, as l
    times the others does not tell.

    Attributes:
      horizon: number of steps H.
      size: number of inputs x.
    """

    def __init__(
        self, rddl: Any, values: Mapping[str, Any], shape: ValueShape, horizon: int, dtype: Any
    ) -> None:
        """Finds the inputs.

        Args:
          rddl: pyRDDLGym's lifted model.
          values: per fluent an array of its shape.
          shape: what the value is made of.
          horizon: number of steps H.
          dtype: floating type of the model.
        """
        self.horizon, self._units, self._dtype = horizon, shape.units, dtype
        self._shapes = {name: tuple(np.shape(values[name])) for name in rddl.state_fluents}
        given = dict(shape.state_scales or {})
        numbers = [name for name in self._shapes if rddl.variable_ranges[name] != "bool"]
        self._scales = {name: given[name] for name in numbers if name in given}
        objects = {name: rddl.variable_ranges[name] for name in numbers}
        self._objects = {
            name: len(rddl.type_to_objects[kind])
            for name, kind in objects.items()
            if kind in rddl.enum_types
        }
        singles = sum(math.prod(size) for size in self._shapes.values())
        singles += sum(math.prod(self._shapes[n]) * count for n, count in self._objects.items())
        self._products = _products(rddl, self._shapes)
        pairs = sum(math.prod(self._shapes[wide]) for _, wide, _ in self._products)
        if singles + pairs > _MOST_INPUTS:
            self._products, pairs = [], 0
        self.size = singles + pairs

    def initial(self, key: Array | np.random.Generator) -> Weights:
        """Weights with which every value is zero.

        Args:
          key: draws the hidden units; with a generator of numpy's nothing is compiled for that.
        """
        scale = min(1.0, math.sqrt(_FEW / max(1, self.size)))
        shapes: list[tuple[int, ...]] = [(self.size, self._units), (self._units,), (self._units,)]
        drawn: list[Any]
        if isinstance(key, np.random.Generator):
            drawn = [key.standard_normal(shape).astype(self._dtype) for shape in shapes]
        else:
            keys = zip(random.split(key, 3), shapes, strict=True)
            drawn = [random.normal(own, shape, self._dtype) for own, shape in keys]
        none, hidden = np.zeros(self.size, self._dtype), np.zeros(self._units, self._dtype)
        return {
            "direct": none,
            "direct_left": none,
            "hidden": scale * drawn[0],
            "bias": drawn[1],
            "bias_left": drawn[2],
            "output": hidden,
            "output_left": hidden,
        }

    def with_levels(self, weights: Weights, levels: Any | None = None) -> Weights:
        """Weights of values that say how much more than usual is expected, with what is usual.

        Args:
          weights: of such values.
          levels: what is expected from each step on, whatever the state [H]; nothing if None.
        """
        usual: Any = np.zeros(self.horizon, self._dtype) if levels is None else levels
        return {**weights, "levels": usual}

    def level(self, weights: Weights, step: Any) -> Array:
        """What is expected from a step on, whatever the state; 0 at the end of the horizon."""
        levels = jnp.append(jnp.asarray(weights["levels"]), 0.0)
        return levels[jnp.minimum(step, self.horizon)]

    @staticmethod
    def rescaled(weights: Weights, factor: Any) -> Weights:
        """Weights whose values are so many times as large."""
        heads = ("direct", "direct_left", "output", "output_left")
        return {n: w * factor if n in heads else w for n, w in weights.items()}

    def inputs(self, state: Mapping[str, Array]) -> Array:
        """What the net reads [size].

        Args:
          state: per state fluent [*shape].
        """
        known = {name: self._scaled(name, state[name]) for name in self._shapes}
        products = [jnp.reshape(known[a], sizes) * known[b] for a, b, sizes in self._products]
        objects = [
            jnp.reshape(state[name], self._shapes[name])[..., jnp.newaxis] == np.arange(count)
            for name, count in self._objects.items()
        ]
        parts = (*known.values(), *objects, *products)
        return jnp.concatenate([jnp.ravel(part).astype(self._dtype) for part in parts])

    def value(self, weights: Weights, inputs: Array, step: Any) -> Array:
        """The return that is expected from a step on; 0 at the end of the horizon."""
        left = jnp.maximum(0.0, 1.0 - jnp.asarray(step, self._dtype) / self.horizon)
        hidden = inputs @ weights["hidden"] + weights["bias"] + left * weights["bias_left"]
        value = inputs @ (weights["direct"] + left * weights["direct_left"])
        value = value + jax.nn.relu(hidden) @ (weights["output"] + left * weights["output_left"])
        return jnp.where(left > 0.0, value, 0.0)

    def changed(
        self, weights: Weights, inputs: Array, places: Any, changes: Array, step: Any
    ) -> Array:
        """The values [D] of inputs of which few are changed, as `value` gives them.

        Args:
          weights: of the net.
          inputs: what the net reads, unchanged [size].
          places: of those that are changed, D times K of them [D, K].
          changes: by how much; those of the same place add up [D, K].
          step: from which on the return is expected.
        """
        left = jnp.maximum(0.0, 1.0 - jnp.asarray(step, self._dtype) / self.horizon)
        direct = weights["direct"] + left * weights["direct_left"]
        hidden = inputs @ weights["hidden"] + weights["bias"] + left * weights["bias_left"]
        value = inputs @ direct + jnp.sum(changes * direct[places], axis=1)
        hidden = hidden + jnp.einsum("dk,dku->du", changes, weights["hidden"][places])
        value = value + jax.nn.relu(hidden) @ (weights["output"] + left * weights["output_left"])
        return jnp.where(left > 0.0, value, 0.0)

    def _scaled(self, name: str, value: Any) -> Array:
        # the environment gives a fluent without parameters as an array of one
        number = jnp.reshape(jnp.asarray(value, self._dtype), self._shapes[name])
        center, scale = self._scales.get(name, (0.0, 1.0))
        return jnp.clip((number - center) / scale, -_LARGEST_INPUT, _LARGEST_INPUT)


def _products(
    rddl: Any, shapes: Mapping[str, tuple[int, ...]]
) -> list[tuple[str, str, tuple[int, ...]]]:
    """Pairs of fluents, the narrow one first, and the shape in which it meets the wide one."""
    found = []
    for number, first in enumerate(shapes):
        for second in list(shapes)[number + 1 :]:
            narrow, wide = sorted((first, second), key=lambda name: len(shapes[name]))
            axes = _places(rddl.variable_params[narrow], rddl.variable_params[wide])
            if axes is not None:
                size = shapes[wide]
                sizes = tuple(size[axis] if axis in axes else 1 for axis in range(len(size)))
                found.append((narrow, wide, sizes))
    return found


def _places(narrow: Sequence[str], wide: Sequence[str]) -> list[int] | None:
    """Where the types of one fluent are among another's, in order; None if they are not."""
    axes: list[int] = []
    for kind in narrow:
        after = axes[-1] + 1 if axes else 0
        place = next((axis for axis in range(after, len(wide)) if wide[axis] == kind), None)
        if place is None:
            return None
        axes.append(place)
    return axes
