"""Expressions of the model as functions, each compiled by itself."""

from collections.abc import Callable, Mapping
from typing import Any

import jax
from jax import Array

Value = Callable[[Mapping[str, Any], Mapping[str, Any]], Array]
"""An expression's value [*shape of its free variables], of fluents and non-fluents."""


def compiled_expression(compiled: Any, expression: Any, dtype: Any = None) -> Value:
    """JaxPlan's function of an expression that draws nothing.

    Args:
      compiled: JaxPlan's compiler of the model.
      expression: traced by pyRDDLGym.
      dtype: of the value; JaxPlan's own if None.
    """
    aux: dict[str, Any] = {"params": {}, "overriden": {}, "exact": set()}
    evaluate, model = compiled._jax(expression, aux, dtype=dtype), dict(aux["params"])

    def value(fluents: Mapping[str, Any], nonfluents: Mapping[str, Any]) -> Array:
        found: Array = evaluate(fluents, nonfluents, model, jax.random.PRNGKey(0))[0]
        return found

    return value
