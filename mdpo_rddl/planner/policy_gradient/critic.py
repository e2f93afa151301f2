"""What a policy is expected to return from a state and step on: a small net."""

import math
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
from jax import Array, random

from mdpo_rddl.planner.plans.feedback import Feedback

_UNITS = 64
_COSINES = 4
_LARGEST_INPUT = 5.0
_HEADS = "output", "direct", "times"

Weights = dict[str, Array]


class Critic:
    """Two tanh layers beside a linear function of the state and a constant for each step.

    The value is scaled by whoever trains it.
    """

    def __init__(self, feedback: Feedback) -> None:
        """Describes the net.

        Args:
          feedback: in whose units states are read.
        """
        self._feedback = feedback
        sizes = (math.prod(shape) for shape in feedback.shapes.values())
        self._inputs = sum(sizes) + 1 + _COSINES

    def initial(self, key: Array) -> Weights:
        """Weights with which every value is zero."""
        first, second = random.split(key)
        dtype = self._feedback.dtype
        inputs = random.normal(first, (self._inputs, _UNITS), dtype) / math.sqrt(self._inputs)
        between = random.normal(second, (_UNITS, _UNITS), dtype) / math.sqrt(_UNITS)
        zeros = {"bias": _UNITS, "between_bias": _UNITS, "output": _UNITS, "direct": self._inputs}
        zeros["times"] = self._feedback.horizon
        return {
            "inputs": inputs,
            "between": between,
            **{name: jnp.zeros(size, dtype) for name, size in zeros.items()},
        }

    def inputs(self, state: Mapping[str, Array], step: Any) -> Array:
        """What the net reads [inputs]."""
        time = jnp.asarray(step, self._feedback.dtype) / self._feedback.horizon
        angles = jnp.pi * time * jnp.arange(1, 1 + _COSINES)
        seen = jnp.concatenate([self._feedback.flat(state), time[jnp.newaxis], jnp.cos(angles)])
        return jnp.clip(seen, -_LARGEST_INPUT, _LARGEST_INPUT)

    def value(self, weights: Weights, inputs: Array, step: Any) -> Array:
        """The scaled return that is expected from a step on."""
        hidden = jnp.tanh(inputs @ weights["inputs"] + weights["bias"])
        hidden = jnp.tanh(hidden @ weights["between"] + weights["between_bias"])
        direct = inputs @ weights["direct"] + weights["times"][step]
        return hidden @ weights["output"] + direct

    @staticmethod
    def rescaled(weights: Weights, factor: Array) -> Weights:
        """Weights whose values are so many times as large."""
        return {n: w * factor if n in _HEADS else w for n, w in weights.items()}
