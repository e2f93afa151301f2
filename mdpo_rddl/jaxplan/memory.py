"""What a rollout keeps for its gradient, and how to keep less where that is too much."""

import logging
import math
from collections.abc import Callable, Mapping
from typing import Any

import jax

logger = logging.getLogger(__name__)

# of all restarts together, by a count that knows nothing of what the compiler fuses and comes out
# about ten times too high
KEPT_BYTES = 5 * 10**8


def bounded_step(step: Callable, carry: Any, inputs: Any, steps: int, copies: int = 1) -> Callable:
    """A step of `jax.lax.scan`, made to be computed again on the way back if it is large.

    Reverse differentiation keeps the values between of all steps. Where they could exceed
    `KEPT_BYTES`, only the carries are kept and each step is computed once more, which takes
    about a third longer.

    Args:
      step: as `jax.lax.scan` takes it.
      carry: the first carry.
      inputs: the inputs of one step.
      steps: number of steps.
      copies: how often the whole is vectorised around it.
    """
    between = _bytes_between(jax.make_jaxpr(step)(carry, inputs).jaxpr)
    if between * steps * copies <= KEPT_BYTES:
        return step
    logger.info("large model: steps of up to %.0f MB are recomputed", between / 1e6)
    return jax.checkpoint(step, prevent_cse=False)


def _bytes_between(jaxpr: Any) -> int:
    """Size of all values that a program computes, the parts of its calls included."""
    total = 0
    for equation in jaxpr.eqns:
        parts = _programs_in(equation.params)
        if parts:
            total += sum(map(_bytes_between, parts))
        else:
            total += sum(_bytes_of(variable.aval) for variable in equation.outvars)
    return total


def _programs_in(params: Mapping[str, Any]) -> list[Any]:
    """The programs that an equation calls, some of them closed over constants."""
    values = [
        value
        for param in params.values()
        for value in (param if isinstance(param, tuple | list) else [param])
    ]
    programs = [getattr(value, "jaxpr", value) for value in values]
    return [program for program in programs if hasattr(program, "eqns")]


def _bytes_of(value: Any) -> int:
    itemsize = getattr(getattr(value, "dtype", None), "itemsize", 0)
    return math.prod(getattr(value, "shape", ())) * itemsize
