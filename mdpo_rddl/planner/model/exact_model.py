"""JaxPlan's exact model with laws that JaxPlan draws more slowly, or otherwise than it should.

JaxPlan's `Weibull` is drawn once for all objects, the environment's for each. JaxPlan's `Dirichlet`
has no number where its parameters are small: all that it divides by underflows. Plans of JaxPlan's
keep both, with its random numbers (`CompilingPlanner`).
"""

from typing import Any

import jax.numpy as jnp
from jax import Array, nn, random

from mdpo_rddl.planner.model.repairs import Drawn, Evaluated, Repairs
from mdpo_rddl.planner.programs.samplers import binomial, poisson


class ExactModel(Repairs):
    """The same model, some of whose laws draw other random numbers than JaxPlan's."""

    def _jax_poisson(self, expr: Any, aux: Any) -> Evaluated:
        def law(key: Array, rate: Array) -> Drawn:
            return poisson(key, rate), rate >= 0.0

        return self._drawn(self._parameters(expr, aux, expr.args, 1), law, "POISSON")

    def _jax_binomial(self, expr: Any, aux: Any) -> Evaluated:
        def law(key: Array, trials: Array, probability: Array) -> Drawn:
            is_law = (probability >= 0.0) & (probability <= 1.0) & (trials >= 0.0)
            return binomial(key, trials, probability), is_law

        return self._drawn(self._parameters(expr, aux, expr.args, 2), law, "BINOMIAL")

    def _jax_weibull(self, expr: Any, aux: Any) -> Evaluated:
        def law(key: Array, shape: Array, scale: Array) -> Drawn:
            both = jnp.broadcast_shapes(shape.shape, scale.shape)
            drawn = random.weibull_min(key, scale, shape, shape=both, dtype=self.REAL)
            return drawn, (shape > 0.0) & (scale > 0.0)

        return self._drawn_number(self._parameters(expr, aux, expr.args, 2), law, "WEIBULL")

    def _jax_dirichlet(self, expr: Any, aux: Any) -> Evaluated:
        (axis,) = self.traced.cached_sim_info(expr)

        def law(key: Array, alpha: Array) -> Drawn:
            # as logarithms, which do not underflow
            logarithms = random.loggamma(key, alpha, dtype=self.REAL)
            return jnp.moveaxis(nn.softmax(logarithms, axis=-1), -1, axis), alpha > 0.0

        parameters = self._parameters(expr, aux, expr.args[1], 1)
        return self._drawn_number(parameters, law, "DIRICHLET")
