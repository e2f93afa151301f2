"""JaxPlan's exact model with counts that are drawn by inversion."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jax import random

from mdpo_rddl.planner.programs.samplers import binomial, poisson
from mdpo_rddl.planner.upstream import JaxRDDLCompiler
from mdpo_rddl.problem.chance import draws_from

_LAWS = frozenset(["Poisson", "Binomial"])

_Evaluated = Callable[..., tuple[Any, Any, Any, Any]]


def exact_model(compiled: JaxRDDLCompiler) -> JaxRDDLCompiler:
    """An exact model that is the same but for the random numbers of such laws, if there are any.

    Args:
      compiled: the exact model, compiled by JaxPlan.
    """
    if not draws_from(compiled.rddl, _LAWS):
        return compiled
    model = ExactModel(compiled.rddl, logger=compiled.logger, **compiled.get_kwargs())
    model.compile(log_jax_expr=True, heading="EXACT MODEL")
    return model


class ExactModel(JaxRDDLCompiler):
    """The same model, whose Poisson and binomial laws draw other random numbers than JAX's."""

    def _jax_poisson(self, expr: Any, aux: Any) -> _Evaluated:
        (rate_of,) = self._arguments(expr, aux, 1)
        code = self.ERROR_CODES["INVALID_PARAM_POISSON"]

        def drawn(fls: Any, nfls: Any, params: Any, key: Any) -> tuple[Any, Any, Any, Any]:
            rate, key, error, params = rate_of(fls, nfls, params, key)
            key, own = random.split(key)
            rate = jnp.asarray(rate, self.REAL)
            count = jnp.asarray(poisson(own, rate), self.INT)
            is_law = jnp.all(rate >= 0.0)
            return count, key, error | (~is_law * code), params

        return drawn

    def _jax_binomial(self, expr: Any, aux: Any) -> _Evaluated:
        trials_of, probability_of = self._arguments(expr, aux, 2)
        code = self.ERROR_CODES["INVALID_PARAM_BINOMIAL"]

        def drawn(fls: Any, nfls: Any, params: Any, key: Any) -> tuple[Any, Any, Any, Any]:
            trials, key, first, params = trials_of(fls, nfls, params, key)
            probability, key, second, params = probability_of(fls, nfls, params, key)
            key, own = random.split(key)
            trials = jnp.asarray(trials, self.REAL)
            probability = jnp.asarray(probability, self.REAL)
            count = jnp.asarray(binomial(own, trials, probability), self.INT)
            is_law = jnp.all((probability >= 0.0) & (probability <= 1.0) & (trials >= 0.0))
            return count, key, first | second | (~is_law * code), params

        return drawn

    def _arguments(self, expr: Any, aux: Any, count: int) -> list[_Evaluated]:
        """What evaluates the parameters of a law."""
        aux["exact"].add(expr.id)
        self._check_num_args(expr, count)
        return [self._jax(argument, aux) for argument in expr.args]
