"""JAX's random numbers at a fraction of the time on a CPU.

JAX computes the hash behind them, Threefry-2x32 with 20 rounds (Salmon et al. 2011, "Parallel
random numbers: as easy as 1, 2, 3"), on CPUs in a loop of five turns, which compiles quickly.
Written out it becomes one kernel together with what follows it. The bits are the same.
"""

from functools import cache
from typing import Any

import jax
import numpy as np
from jax import Array
from jax.extend.random import define_prng_impl, threefry2x32_p, threefry_prng_impl

from mdpo_rddl.machine.device import is_on_cpu
from mdpo_rddl.planner.programs.traced import bind, replay

_ROTATIONS = ((13, 15, 26, 6), (17, 29, 16, 24))
_PARITY = 0x1BD11BDA
# what may be done with a key whose hash is another function
_OF_KEYS = frozenset(
    [
        "random_bits",
        "random_fold_in",
        "random_split",
        "random_unwrap",
        "random_wrap",
        "broadcast_in_dim",
        "dynamic_slice",
        "gather",
        "reshape",
        "slice",
        "squeeze",
        "transpose",
        "unstack",
    ]
)


def threefry_2x32(key: tuple[Array, Array], block: tuple[Array, Array]) -> list[Array]:
    """The hash of blocks of two words, with all rounds written out.

    Args:
      key: two words, arrays of uint32.
      block: two words, arrays of uint32 that broadcast with the key's.
    """
    first, second = key
    schedule = (first, second, first ^ second ^ np.uint32(_PARITY))
    left, right = block[0] + first, block[1] + second
    for turn in range(1, 6):
        for rotation in _ROTATIONS[(turn - 1) % 2]:
            left = left + right
            right = (right << np.uint32(rotation)) | (right >> np.uint32(32 - rotation))
            right = right ^ left
        left = left + schedule[turn % 3]
        right = right + schedule[(turn + 1) % 3] + np.uint32(turn)
    return [left, right]


def is_written_out() -> bool:
    """Whether the hash is: other devices have kernels of their own for it."""
    return is_on_cpu()


def bind_written_out(primitive: Any, params: dict[str, Any], operands: Any) -> list[Any]:
    """As `programs.bind`, with the hash written out: where a key is made, and where it is used.

    What fixes the function behind its keys, such as a loop that carries them, has JAX's own.
    """
    if primitive is threefry2x32_p:
        first, second, *block = operands
        return threefry_2x32((first, second), tuple(block))
    if primitive.name == "random_wrap" and params["impl"] == threefry_prng_impl:
        return [jax.random.wrap_key_data(*operands, impl=_written_out_impl())]
    if primitive.name not in _OF_KEYS:
        operands = [_as_jax_has_it(operand) for operand in operands]
    return bind(primitive, params, operands)


def _as_jax_has_it(operand: Any) -> Any:
    """The same key for JAX's own hash; anything else as it is."""
    if getattr(operand, "dtype", None) != _written_out_dtype():
        return operand
    return jax.random.wrap_key_data(jax.random.key_data(operand), impl=threefry_prng_impl)


@cache
def _written_out_dtype() -> Any:
    return jax.random.key(0, impl=_written_out_impl()).dtype


@cache
def _written_out_impl() -> Any:
    """JAX's own generator over the written-out hash, with its way to split and to count."""
    own = threefry_prng_impl

    def written_out(function: Any, key: Array) -> Array:
        program = jax.make_jaxpr(function)(key)
        (result,) = replay(
            program, [key], lambda e, operands: bind_written_out(e.primitive, e.params, operands)
        )
        return result

    return define_prng_impl(
        key_shape=own.key_shape,
        seed=own.seed,
        split=lambda key, shape: written_out(lambda k: own.split(k, shape), key),
        random_bits=lambda key, width, shape: written_out(
            lambda k: own.random_bits(k, width, shape), key
        ),
        fold_in=lambda key, data: written_out(lambda k: own.fold_in(k, data), key),
        name="threefry2x32 written out",
        tag="fryw",
    )
