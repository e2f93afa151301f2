"""Programs that are compiled in less time.

On a CPU, rollouts of the exact model with less of LLVM's optimisation are compiled in 0.86 of the
time in the mean, and a call takes 1.02 times as long; the options of quick programs say 0.52 and
1.31 there (`results/rollout_programs`, twelve programs of six problems).

The actions of `GreedyPlan`, and the rollouts of a decision and their gradients, are of the quick
kind too: they are compiled while somebody waits, and their calls last milliseconds.

Training programs that are compiled in half the time are slower: they are for searches of a minute.
There XLA's newer code for fused loops takes longer to compile than it saves there: on HVAC 4 of
IPC 2023 the calls of JaxPlan's deep reactive policy are compiled in half the time without it, and
make two thirds of the iterations a second; on HVAC 2, in a minute, the gradient of the feedback
policy came too late with it. Since jaxlib 0.11.1 XLA has no older code: quick programs are light
ones there. Other devices have no such options.
"""

import functools
import os
from collections.abc import Callable, Mapping
from typing import Any

import jax

from mdpo_rddl.machine.device import is_on_cpu

Jit = Callable[[Callable[..., Any]], Callable[..., Any]]
"""What stands in for `jax.jit`."""

LIGHT = {"xla_backend_optimization_level": 1}
ONCE = {"xla_backend_optimization_level": 0}
QUICK_OPTIONS = {**LIGHT, "xla_cpu_use_fusion_emitters": False}
_LONGEST_SECONDS = 180.0
# about what a quick program takes to compile, in terms of others
_QUICK_SHARE = 0.6


def quick_share() -> float:
    """About what a quick program takes to compile, in terms of others."""
    is_quick = is_on_cpu() and all(_is_known(name, value) for name, value in QUICK_OPTIONS.items())
    return _QUICK_SHARE if is_quick else 1.0


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


def once_jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """`jax.jit` for what is called once or twice: on a CPU hardly optimised at all.

    A call takes several times as long; results may differ by rounding.
    """
    return _on_cpu(function, ONCE)


def _on_cpu(function: Callable[..., Any], options: Mapping[str, Any]) -> Callable[..., Any]:
    """With these options on a CPU, but for those that `XLA_FLAGS` names or XLA does not have.

    As a part of another program it has that one's: JAX refuses options there.
    """
    whole = jax.jit(function, compiler_options=_possible(options))

    @functools.wraps(function)
    def call(*arguments: Any, **keywords: Any) -> Any:
        leaves = jax.tree.leaves((arguments, keywords))
        is_part = any(isinstance(leaf, jax.core.Tracer) for leaf in leaves)
        return (jax.jit(function) if is_part else whole)(*arguments, **keywords)

    return call


def _possible(options: Mapping[str, Any]) -> dict[str, Any] | None:
    if not is_on_cpu():
        return None
    flags = os.environ.get("XLA_FLAGS", "")
    ours = {name: value for name, value in options.items() if name not in flags}
    return {name: value for name, value in ours.items() if _is_known(name, value)}


@functools.cache
def _is_known(name: str, value: Any) -> bool:
    """Whether XLA has the option, which only an attempt tells (20 ms)."""
    try:
        jax.jit(lambda: 0, compiler_options={name: value})()
    except jax.errors.JaxRuntimeError as error:
        if name not in str(error):
            raise
        return False
    return True
