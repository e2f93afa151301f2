"""Programs that are compiled in less time.

On a CPU, rollouts of the exact model with less of LLVM's optimisation are compiled in 0.86 of the
time in the mean, and a call takes 1.02 times as long; the options of quick programs say 0.52 and
1.31 there (`results/rollout_programs`, twelve programs of six problems).

Training programs that are compiled in half the time are slower: they are for searches of a minute.
There XLA's newer code for fused loops takes longer to compile than it saves there: on HVAC 4 of
IPC 2023 the calls of JaxPlan's deep reactive policy are compiled in half the time without it, and
make two thirds of the iterations a second; on HVAC 2, in a minute, the gradient of the feedback
policy came too late with it. Other devices have no such options.
"""

import functools
import os
from collections.abc import Callable, Mapping
from typing import Any

import jax

Jit = Callable[[Callable[..., Any]], Callable[..., Any]]
"""What stands in for `jax.jit`."""

QUICK = 0.6
"""About what such a program takes to compile, in terms of others."""
LIGHT = {"xla_backend_optimization_level": 1}
QUICK_OPTIONS = {**LIGHT, "xla_cpu_use_fusion_emitters": False}
_LONGEST_SECONDS = 180.0


def is_short(seconds: float) -> bool:
    """Whether a search of so many seconds, compilation included, has better programs of this kind.

    Args:
      seconds: of all of the search.
    """
    return seconds <= _LONGEST_SECONDS


def jit_for(seconds: float) -> Jit:
    """What compiles the training calls of such a search.

    Args:
      seconds: of all of the search.
    """
    return quick_jit if is_short(seconds) else jax.jit


def quick_jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """`jax.jit`, on a CPU with less optimisation."""
    return _on_cpu(function, QUICK_OPTIONS)


def light_jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """`jax.jit` for rollouts of the exact model, which run about as fast."""
    return _on_cpu(function, LIGHT)


def _on_cpu(function: Callable[..., Any], options: Mapping[str, Any]) -> Callable[..., Any]:
    """With these options on a CPU, but for those that `XLA_FLAGS` names.

    As a part of another program it has that one's: JAX refuses options there.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    ours = {name: value for name, value in options.items() if name not in flags}
    is_cpu = jax.default_backend() == "cpu"
    whole = jax.jit(function, compiler_options=ours if is_cpu else None)

    @functools.wraps(function)
    def call(*arguments: Any, **keywords: Any) -> Any:
        leaves = jax.tree.leaves((arguments, keywords))
        is_part = any(isinstance(leaf, jax.core.Tracer) for leaf in leaves)
        return (jax.jit(function) if is_part else whole)(*arguments, **keywords)

    return call
