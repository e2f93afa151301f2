"""What JaxPlan's compilers cannot compile of RDDL, and what they compile otherwise than it is.

`ln` calls a function that JAX does not have. The function `gamma[x]` is hidden by the law
`Gamma(k, s)` of the same name. The laws `NegativeBinomial` and `Multinomial` are drawn by
tensorflow-probability, whose newest release (0.25.0) needs a JAX before 0.7
(https://github.com/tensorflow/probability/issues/2009); here they are drawn without it.

The environment is right where they differ. Its `Pareto` begins at 0, JaxPlan's at the scale. Its
whole numbers divided by zero are 0, and so is what is left over. It refuses counts of no chance
(`Geometric(0)`), which JaxPlan does not report. It refuses `gamma` and `lngamma` of what is not
positive, and whole numbers to negative powers: in the exact model these are no numbers, so that
nothing is gained by them.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
from jax import Array, lax, random
from jax.scipy import special

from mdpo_rddl.planner.programs.samplers import multinomial, negative_binomial
from mdpo_rddl.planner.upstream import JaxRDDLCompiler, logic
from mdpo_rddl.problem.enumeration.forms import is_whole

Evaluated = Callable[..., tuple[Any, Any, Any, Any]]
"""Of fluents, non-fluents, the model's parameters and a random key: the value, the next key, the
bits of errors, and the parameters."""

Drawn = tuple[Array, Array]
"""Values of a law [*shape], and whether its parameters are those of a law."""

_Law = Callable[..., Drawn]


class Repairs(JaxRDDLCompiler):
    """A compiler of JaxPlan's with the environment's functions and laws."""

    @property
    def _is_relaxed(self) -> bool:
        """Whether whole numbers need not be whole, so that gradients may leave a domain."""
        return isinstance(self, logic.JaxRDDLCompilerWithGrad)

    def _jax_ln(self, expr: Any, aux: Any) -> Evaluated:
        aux["exact"].add(expr.id)
        evaluated: Evaluated = self._jax_unary_helper(expr, aux, jnp.log, at_least_int=True)
        return evaluated

    def _jax_gamma(self, expr: Any, aux: Any) -> Evaluated:
        evaluated: Evaluated
        if expr.etype[0] == "func":
            aux["exact"].add(expr.id)
            gamma = special.gamma if self._is_relaxed else _of_positive(special.gamma)
            evaluated = self._jax_unary_helper(expr, aux, gamma, at_least_int=True)
        else:
            evaluated = super()._jax_gamma(expr, aux)
        return evaluated

    def _jax_lngamma(self, expr: Any, aux: Any) -> Evaluated:
        aux["exact"].add(expr.id)
        function = special.gammaln if self._is_relaxed else _of_positive(special.gammaln)
        evaluated: Evaluated = self._jax_unary_helper(expr, aux, function, at_least_int=True)
        return evaluated

    def _jax_pow(self, expr: Any, aux: Any) -> Evaluated:
        is_whole_power = is_whole(self.rddl, expr) and not expr.args[1].is_constant_expression()
        if self._is_relaxed or not is_whole_power:
            evaluated: Evaluated = super()._jax_pow(expr, aux)
        else:
            aux["exact"].add(expr.id)
            evaluated = self._jax_binary_helper(expr, aux, _whole_power, at_least_int=True)
        return evaluated

    # what both models' `div` and `mod` are made by

    def _jax_binary_helper(self, expr: Any, aux: Any, jax_op: Any, **options: Any) -> Evaluated:
        if self._divides_whole_numbers(expr):
            jax_op = _zero_by_zero(jax_op, lambda quotient: (quotient,), lambda parts: parts[0])
        evaluated: Evaluated = super()._jax_binary_helper(expr, aux, jax_op, **options)
        return evaluated

    def _jax_binary_helper_with_param(
        self, expr: Any, aux: Any, jax_op: Any, **options: Any
    ) -> Evaluated:
        if self._divides_whole_numbers(expr):
            jax_op = _zero_by_zero(jax_op, tuple, tuple)
        # of the relaxed compilers only
        with_param: Any = super()
        evaluated: Evaluated = with_param._jax_binary_helper_with_param(
            expr, aux, jax_op, **options
        )
        return evaluated

    def _divides_whole_numbers(self, expr: Any) -> bool:
        kind, name = expr.etype
        if kind != "func" or name not in ("div", "mod", "fmod"):
            return False
        return name != "fmod" or is_whole(self.rddl, expr)

    def _jax_pareto(self, expr: Any, aux: Any) -> Evaluated:
        def law(key: Array, shape: Array, scale: Array) -> Drawn:
            drawn = random.exponential(key, shape.shape, self.REAL)
            return scale * jnp.expm1(drawn / shape), (shape > 0.0) & (scale > 0.0)

        return self._drawn_number(self._parameters(expr, aux, expr.args, 2), law, "PARETO")

    def _jax_geometric(self, expr: Any, aux: Any) -> Evaluated:
        if self._is_relaxed:
            relaxed: Evaluated = super()._jax_geometric(expr, aux)
            return relaxed

        def law(key: Array, probability: Array) -> Drawn:
            is_law = (probability > 0.0) & (probability <= 1.0)
            return random.geometric(key, probability, dtype=self.INT), is_law

        return self._drawn(self._parameters(expr, aux, expr.args, 1), law, "GEOMETRIC")

    def _jax_negative_binomial(self, expr: Any, aux: Any) -> Evaluated:
        relaxed = super()._jax_negative_binomial
        is_relaxed = relaxed.__func__ is not JaxRDDLCompiler._jax_negative_binomial
        if is_relaxed and any(map(self.traced.cached_is_fluent, expr.args)):
            evaluated: Evaluated = relaxed(expr, aux)
            return evaluated

        def law(key: Array, count: Array, probability: Array) -> Drawn:
            # of no chance numpy draws no count
            is_law = (probability > 0.0) & (probability <= 1.0) & (count > 0.0)
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
        """What draws counts from a law; as for `_drawn_number`."""

        def counted(key: Array, *values: Array) -> Drawn:
            # counts have no gradient, and the loops that draw them none that runs backwards
            return law(key, *map(lax.stop_gradient, values))

        drawn = self._drawn_number(parameters, counted, name)

        def counts(fls: Any, nfls: Any, params: Any, key: Any) -> tuple[Any, Any, Any, Any]:
            value, *rest = drawn(fls, nfls, params, key)
            return (jnp.asarray(value, self.INT), *rest)

        return counts

    def _drawn_number(self, parameters: Sequence[Evaluated], law: _Law, name: str) -> Evaluated:
        """What draws from a law.

        Args:
          parameters: what evaluates them.
          law: gives values and whether this is a law, of a random key and the parameters.
          name: of the law's code among JaxPlan's.
        """
        code = self.ERROR_CODES[f"INVALID_PARAM_{name}"]

        def drawn(fls: Any, nfls: Any, params: Any, key: Any) -> tuple[Any, Any, Any, Any]:
            values, error = [], jnp.asarray(0)
            for parameter in parameters:
                value, key, own_error, params = parameter(fls, nfls, params, key)
                values.append(jnp.asarray(value, self.REAL))
                error = error | own_error
            key, own = random.split(key)
            found, is_law = law(own, *values)
            return found, key, error | (~jnp.all(is_law) * code), params

        return drawn


def _of_positive(function: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """The function of positive numbers; of others no number."""
    return lambda x: jnp.where(x > 0, function(jnp.where(x > 0, x, 1)), jnp.nan)


def _whole_power(base: Array, exponent: Array) -> Array:
    power = jnp.power(base, jnp.maximum(exponent, 0))
    return jnp.where(exponent < 0, jnp.nan, power)


def _zero_by_zero(
    divide: Callable[..., Any], parts: Callable[..., tuple[Any, ...]], whole: Callable[..., Any]
) -> Callable[..., Any]:
    """A division whose result is 0 where the divisor is.

    Args:
      divide: of a dividend, a divisor, and what else it takes.
      parts: what it gives as a tuple, the quotient first.
      whole: what it gives, of that tuple.
    """

    def divided(x: Array, y: Array, *rest: Any) -> Any:
        quotient, *others = parts(divide(x, jnp.where(y == 0, jnp.ones_like(y), y), *rest))
        return whole((jnp.where(y == 0, jnp.zeros_like(quotient), quotient), *others))

    return divided


@functools.cache
def repaired(kind: type[JaxRDDLCompiler]) -> type[JaxRDDLCompiler]:
    """A compiler of JaxPlan's with `Repairs`, and of the same name."""
    return type(kind.__name__, (Repairs, kind), {})
