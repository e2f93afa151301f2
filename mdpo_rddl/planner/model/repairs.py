"""What JaxPlan's compilers cannot compile of RDDL, or only with a package that no longer works.

`ln` calls a function that JAX does not have. The function `gamma[x]` is hidden by the law
`Gamma(k, s)` of the same name. The laws `NegativeBinomial` and `Multinomial` are drawn by
tensorflow-probability, whose newest release (0.25.0) needs a JAX before 0.7
(https://github.com/tensorflow/probability/issues/2009); here they are drawn without it.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
from jax import Array, lax, random
from jax.scipy import special

from mdpo_rddl.planner.programs.samplers import multinomial, negative_binomial
from mdpo_rddl.planner.upstream import JaxRDDLCompiler

Evaluated = Callable[..., tuple[Any, Any, Any, Any]]
"""Of fluents, non-fluents, the model's parameters and a random key: the value, the next key, the
bits of errors, and the parameters."""

Drawn = tuple[Array, Array]
"""Counts of a law [*shape], and whether its parameters are those of a law."""

_Law = Callable[..., Drawn]


class Repairs(JaxRDDLCompiler):
    """A compiler of JaxPlan's with `ln`, `gamma`, `NegativeBinomial` and `Multinomial`."""

    def _jax_ln(self, expr: Any, aux: Any) -> Evaluated:
        aux["exact"].add(expr.id)
        evaluated: Evaluated = self._jax_unary_helper(expr, aux, jnp.log, at_least_int=True)
        return evaluated

    def _jax_gamma(self, expr: Any, aux: Any) -> Evaluated:
        evaluated: Evaluated
        if expr.etype[0] == "func":
            aux["exact"].add(expr.id)
            evaluated = self._jax_unary_helper(expr, aux, special.gamma, at_least_int=True)
        else:
            evaluated = super()._jax_gamma(expr, aux)
        return evaluated

    def _jax_negative_binomial(self, expr: Any, aux: Any) -> Evaluated:
        relaxed = super()._jax_negative_binomial
        is_relaxed = relaxed.__func__ is not JaxRDDLCompiler._jax_negative_binomial
        if is_relaxed and any(map(self.traced.cached_is_fluent, expr.args)):
            evaluated: Evaluated = relaxed(expr, aux)
            return evaluated

        def law(key: Array, count: Array, probability: Array) -> Drawn:
            is_law = (probability >= 0.0) & (probability <= 1.0) & (count > 0.0)
            return negative_binomial(key, count, probability), is_law

        return self._drawn(self._parameters(expr, aux, expr.args, 2), law, "NEGATIVE_BINOMIAL")

    def _jax_multinomial(self, expr: Any, aux: Any) -> Evaluated:
        (axis,) = self.traced.cached_sim_info(expr)

        def law(key: Array, trials: Array, shares: Array) -> Drawn:
            sums = jnp.sum(shares, axis=-1)
            is_law = jnp.all(shares >= 0.0) & jnp.allclose(sums, 1.0) & jnp.all(trials >= 0.0)
            counts = multinomial(key, trials, shares)
            return jnp.moveaxis(counts, -1, axis), is_law

        return self._drawn(self._parameters(expr, aux, expr.args[1], 2), law, "MULTINOMIAL")

    def _parameters(self, expr: Any, aux: Any, given: Sequence[Any], count: int) -> list[Evaluated]:
        """What evaluates the parameters of a law that is drawn as it is.

        Args:
          expr: of the draw.
          aux: of the model.
          given: the parameters' expressions.
          count: how many the law has.

        Raises:
          ValueError: if there are fewer or more.
        """
        if len(given) != count:
            raise ValueError(f"{expr.etype[1]} has {count} parameters, got {len(given)}")
        aux["exact"].add(expr.id)
        return [self._jax(parameter, aux) for parameter in given]

    def _drawn(self, parameters: Sequence[Evaluated], law: _Law, name: str) -> Evaluated:
        """What draws counts from a law.

        Args:
          parameters: what evaluates them.
          law: gives counts and whether this is a law, of a random key and the parameters.
          name: of the law's code among JaxPlan's.
        """
        code = self.ERROR_CODES[f"INVALID_PARAM_{name}"]

        def drawn(fls: Any, nfls: Any, params: Any, key: Any) -> tuple[Any, Any, Any, Any]:
            values, error = [], jnp.asarray(0)
            for parameter in parameters:
                value, key, own_error, params = parameter(fls, nfls, params, key)
                # counts have no gradient, and the loops that draw them none that runs backwards
                values.append(lax.stop_gradient(jnp.asarray(value, self.REAL)))
                error = error | own_error
            key, own = random.split(key)
            counts, is_law = law(own, *values)
            return jnp.asarray(counts, self.INT), key, error | (~jnp.all(is_law) * code), params

        return drawn


@functools.cache
def repaired(kind: type[JaxRDDLCompiler]) -> type[JaxRDDLCompiler]:
    """A compiler of JaxPlan's with `Repairs`, and of the same name."""
    return type(kind.__name__, (Repairs, kind), {})
