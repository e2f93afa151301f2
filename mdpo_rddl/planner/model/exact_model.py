"""JaxPlan's exact model with counts that are drawn by inversion."""

from typing import Any

from jax import Array

from mdpo_rddl.planner.model.repairs import Drawn, Evaluated, Repairs
from mdpo_rddl.planner.programs.samplers import binomial, poisson


class ExactModel(Repairs):
    """The same model, whose Poisson and binomial laws draw other random numbers than JAX's."""

    def _jax_poisson(self, expr: Any, aux: Any) -> Evaluated:
        def law(key: Array, rate: Array) -> Drawn:
            return poisson(key, rate), rate >= 0.0

        return self._drawn(self._parameters(expr, aux, expr.args, 1), law, "POISSON")

    def _jax_binomial(self, expr: Any, aux: Any) -> Evaluated:
        def law(key: Array, trials: Array, probability: Array) -> Drawn:
            is_law = (probability >= 0.0) & (probability <= 1.0) & (trials >= 0.0)
            return binomial(key, trials, probability), is_law

        return self._drawn(self._parameters(expr, aux, expr.args, 2), law, "BINOMIAL")
