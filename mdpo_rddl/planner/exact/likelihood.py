"""How likely an observation is in a state, from the laws that the exact model states."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
from jax import Array

from mdpo_rddl.planner.model.expressions import compiled_expression
from mdpo_rddl.problem.chance import draws

ROUNDING = 1e-4
"""Of a scale: what rounding may differ by."""
LEAST = -30.0
"""Log-likelihood of a component that cannot be: with it, the fewest mismatches weigh most."""

Law = Callable[[Mapping[str, Any], Array], Array]
"""(all fluents after a step, observed values [*shape]) -> log-densities [*shape]."""

_LOG_2_PI = math.log(2.0 * math.pi)


class Likelihood:
    """Log-likelihoods of the components of an observation, each at least `LEAST`.

    Components are independent given the state that follows and the action, as RDDL has it. Read are
    Bernoulli, Normal and certain laws, and choices between them; every other bool, integer or
    object must equal what the state's own rollout has drawn, and of every other real the
    distance from that is kept, for a kernel.

    Attributes:
      kernels: observation fluents of which no density is known.
    """

    def __init__(self, compiled: Any) -> None:
        """Reads the observations' laws.

        Args:
          compiled: the exact model as JaxPlan compiles it.
        """
        rddl = compiled.rddl
        self._nonfluents = compiled.split_fluent_nonfluent(compiled.init_values)[1]
        self._names = list(rddl.observ_fluents)
        self._is_real = {name: rddl.variable_ranges[name] == "real" for name in self._names}
        laws = {name: self._law(compiled, name) for name in self._names}
        self._laws = {name: law for name, law in laws.items() if law is not None}
        self.kernels = [n for n in self._names if n not in self._laws and self._is_real[n]]

    def __call__(
        self, fluents: Mapping[str, Array], seen: Mapping[str, Array]
    ) -> tuple[Array, dict[str, Array]]:
        """The log-likelihood where it is known, and the distances where it is not.

        Args:
          fluents: of one state: before the step, the actions, and all that follows from them, with
            the observations drawn there [*shape].
          seen: per observation fluent what was observed [*shape].

        Returns:
          The components' log-likelihoods side by side [N], and per fluent of `kernels` what was
          observed less what was drawn [*shape].
        """
        found, distances = [], {}
        for name in self._names:
            drawn = jnp.asarray(fluents[name])
            value = jnp.reshape(jnp.asarray(seen[name], drawn.dtype), drawn.shape)
            if name in self._laws:
                density = self._laws[name](fluents, value)
                found.append(jnp.broadcast_to(density, drawn.shape))
            elif name in self.kernels:
                distances[name] = value - drawn
            else:
                found.append(_certain(drawn, value))
        parts = [jnp.ravel(part) for part in found]
        known = jnp.concatenate(parts) if parts else jnp.zeros(0)
        return jnp.maximum(jnp.nan_to_num(known, nan=LEAST), LEAST), distances

    def _law(self, compiled: Any, name: str) -> Law | None:
        _, expression = compiled.rddl.cpfs[name]

        def compile_one(part: Any) -> Callable[[Mapping[str, Any]], Array]:
            value = compiled_expression(compiled, part)
            return lambda fluents: value(fluents, self._nonfluents)

        return _read(compile_one, expression, self._is_real[name])


def _read(compile_one: Callable[[Any], Any], expression: Any, is_real: bool) -> Law | None:
    """The law of an expression; None where it is of another kind than those that are read."""
    kind, arguments = expression.etype[1], expression.args
    if not draws(expression):
        certain = compile_one(expression)
        return None if is_real else lambda fluents, value: _certain(certain(fluents), value)
    if any(draws(part) for part in arguments[: 1 if kind == "if" else None]):
        return None
    if kind == "Bernoulli":
        (probability,) = map(compile_one, arguments)
        return lambda fluents, value: _bernoulli(probability(fluents), value)
    if kind == "Normal":
        mean, variance = map(compile_one, arguments)
        return lambda fluents, value: _normal(mean(fluents), variance(fluents), value)
    if kind != "if":
        return None
    condition = compile_one(arguments[0])
    first, second = (_read(compile_one, part, is_real) for part in arguments[1:])
    if first is None or second is None:
        return None
    return lambda fluents, value: jnp.where(
        condition(fluents) > 0.5, first(fluents, value), second(fluents, value)
    )


def _certain(expected: Any, value: Array) -> Array:
    return jnp.where(jnp.asarray(expected).astype(value.dtype) == value, 0.0, LEAST)


def _bernoulli(probability: Any, value: Array) -> Array:
    return jnp.log(jnp.where(value, probability, 1.0 - probability))


def _normal(mean: Any, variance: Any, value: Array) -> Array:
    # a variance of 0 has no density
    variance = jnp.maximum(variance, jnp.square(ROUNDING * (1.0 + jnp.abs(mean))))
    return -0.5 * (jnp.square(value - mean) / variance + jnp.log(variance) + _LOG_2_PI)
