"""Parallel updates in pairs: JaxPlan's own, and beside each of them one with noise.

Update i of JaxPlan's R is lane i, its noisy companion lane R + i. JAX's initial key of a lane does
not depend on how many lanes there are, and the first R are updated by JaxPlan's own update, so that
their training is JaxPlan's but for rounding.
"""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, random

from mdpo_rddl.planner.update.finite import finite_lanes

# folded into JaxPlan's key of an iteration
_NOISY_STREAM = 0x706169
# what a return that is not a number counts as, in units of the largest finite one: it is never
# the best, and JaxPlan's running sums still keep their last digits
_PENALTY = 1e3

_BY_LANE = (
    "train_return",
    "test_return",
    "pgpe_return",
    "params",
    "pgpe_params",
    "model_params",
    "grad",
    "train_log",
    "test_log",
    "sigma",
    "sensitivity",
)


@contextlib.contextmanager
def half_the_lanes(planner: Any, wanted: bool) -> Iterator[None]:
    """Has a planner compile for JaxPlan's number of parallel updates instead of all lanes."""
    lanes = planner.parallel_updates
    planner.parallel_updates = lanes // 2 if wanted else lanes
    try:
        yield
    finally:
        planner.parallel_updates = lanes


def side_by_side(plain: Callable, noisy: Callable, horizon: int) -> Callable:
    """One update of all lanes: JaxPlan's compiled update as it is, and the noisy one.

    Args:
      plain: JaxPlan's batched update of R lanes.
      noisy: the same with noise, whose log has `sigma` and `sensitivity` besides.
      horizon: number of steps H.

    Returns:
      A function with the arguments and results of JaxPlan's update of 2 R lanes.
    """

    def update(*arguments):
        key, params, hyperparams, fluents, nonfluents, model, critic, opt_state, opt_aux = arguments
        halves = _split((params, model, opt_state, opt_aux))
        keys = key, random.fold_in(key, _NOISY_STREAM)
        results = [
            function(key, params, hyperparams, fluents, nonfluents, model, critic, state, aux)
            for function, key, (params, model, state, aux) in zip(
                (plain, noisy), keys, halves, strict=True
            )
        ]
        log = results[0][5]
        silence = jnp.zeros((len(results[0][1]), horizon), results[1][5]["sigma"].dtype)
        log = {**log, "sigma": silence, "sensitivity": silence}
        return _join((*results[0][:5], log, *results[0][6:]), results[1])

    return update


@jax.jit
def _split(tree: Any) -> tuple[Any, Any]:
    def half(second: bool) -> Any:
        return jax.tree.map(lambda leaf: jnp.split(leaf, 2)[second], tree)

    return half(False), half(True)


@jax.jit
def _join(first: Any, second: Any) -> Any:
    return jax.tree.map(lambda one, other: jnp.concatenate([one, other]), first, second)


def finite_test_loss(test_loss: Callable) -> Callable:
    """JaxPlan's batched test loss, in which a lane that diverged does not hide the others.

    JaxPlan takes a loss that is not a number for the smallest one. Here it counts as a large
    one, unless no lane has a finite loss, and so does that of parameters that are no numbers.
    """

    @jax.jit
    def comparable(losses: Array, params: Any) -> Array:
        losses = jnp.where(finite_lanes(params), losses, jnp.nan)
        finite = jnp.isfinite(losses)
        largest = jnp.max(jnp.where(finite, jnp.abs(losses), 0.0))
        replaced = jnp.where(finite, losses, _PENALTY * (1.0 + largest))
        return jnp.where(jnp.any(finite), replaced, losses)

    def finite(*arguments: Any) -> Any:
        losses, rest = test_loss(*arguments)
        return comparable(losses, arguments[1]), rest

    return finite


@jax.jit
def _select(tree: Any, lanes: Array) -> Any:
    return jax.tree.map(lambda leaf: leaf[lanes], tree)


def folded(callback: Mapping[str, Any]) -> dict[str, Any]:
    """The entries of a callback with one row for each pair: that of the better test return.

    Args:
      callback: JaxPlan's, with a leading axis of lanes [2 R, ...].

    Returns:
      The entries that have that axis, now [R, ...], and `best_index`, the pair of the best.
    """
    returns = np.asarray(callback["test_return"])
    plain, noisy = np.split(np.where(np.isfinite(returns), returns, -np.inf), 2)
    pairs = np.arange(len(plain))
    lanes = np.where(noisy > plain, pairs + len(plain), pairs)
    return {
        **of_lanes(callback, lanes),
        "best_index": int(callback["best_index"]) % len(plain),
    }


def of_lanes(callback: Mapping[str, Any], lanes: np.ndarray) -> dict[str, Any]:
    """The entries of a callback that have a row for each lane, of some lanes.

    Args:
      callback: JaxPlan's, with a leading axis of lanes.
      lanes: their indices.
    """
    entries: dict[str, Any] = {}
    on_device = {}
    for name in _BY_LANE:
        value = callback.get(name)
        if isinstance(value, np.ndarray):
            entries[name] = value[lanes]
        elif value is not None:
            on_device[name] = value
    entries.update(_select(on_device, lanes))
    return entries
