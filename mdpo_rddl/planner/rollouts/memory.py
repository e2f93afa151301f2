"""What a rollout keeps for its gradient, and how to keep less where that is too much."""

import logging
import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

logger = logging.getLogger(__name__)

# of all restarts together, by a count that comes out several times too high, since it knows
# nothing of what the compiler fuses
KEPT_BYTES = 5 * 10**8
# longer blocks keep more and save hardly any time
_BLOCK_STEPS = 16


def bounded_scan(
    step: Callable[[Any, Any], tuple[Any, Any]], start: Any, inputs: Any, copies: int = 1
) -> tuple[Any, Any]:
    """`jax.lax.scan` that keeps a bounded part of its values for its gradient.

    Reverse differentiation keeps the values between of all steps. Where they could exceed
    `KEPT_BYTES`, the steps are taken in blocks, of which only the first state is kept; each
    block is computed once more on the way back. Blocks of a model so large that two steps do
    not fit are single steps, which takes longer.

    Args:
      step: gives the next carry and an output, of a carry and one step's inputs.
      start: the first carry.
      inputs: of all steps, each leaf [H, ...].
      copies: how often the whole is vectorised around it.

    Returns:
      The last carry, and the outputs, each leaf [H, ...].
    """
    steps = len(jax.tree.leaves(inputs)[0])
    first = jax.tree.map(lambda leaf: leaf[0], inputs)
    between = copies * _bytes_between(jax.make_jaxpr(step)(start, first).jaxpr)
    fitting = int(KEPT_BYTES // max(between, 1))
    if fitting >= steps:
        return lax.scan(step, start, inputs)
    size = _block_size(steps, fitting)
    count, rest = divmod(steps, size)
    logger.info("large model: %.0f MB a step, computed again in blocks of %d", between / 1e6, size)

    @partial(jax.checkpoint, prevent_cse=False)
    def block(carry: Any, inputs: Any) -> tuple[Any, Any]:
        return lax.scan(step, carry, inputs)

    early = count * size
    blocks = jax.tree.map(lambda leaf: leaf[:early].reshape(count, size, *leaf.shape[1:]), inputs)
    carry, outputs = lax.scan(block, start, blocks)
    outputs = jax.tree.map(lambda leaf: leaf.reshape(early, *leaf.shape[2:]), outputs)
    if not rest:
        return carry, outputs
    end, late = lax.scan(step, carry, jax.tree.map(lambda leaf: leaf[early:], inputs))
    return end, jax.tree.map(lambda *parts: jnp.concatenate(parts), outputs, late)


def _block_size(steps: int, fitting: int) -> int:
    """Steps of a block: few are left over, since they are compiled apart."""
    largest = max(1, min(_BLOCK_STEPS, fitting))
    sizes = range(largest, largest // 2, -1)
    return min(sizes, key=lambda size: steps % size)


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
