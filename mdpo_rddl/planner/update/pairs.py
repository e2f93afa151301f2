"""Parallel updates in pairs: JaxPlan's own, and beside each of them one with noise.

Update i of JaxPlan's R is lane i, its noisy companion lane R + i. JAX's keys of a lane do not
depend on how many lanes there are, so that the first R draw what they draw in JaxPlan.
"""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.noise import ActionNoise

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


def paired_rules(noise: ActionNoise, broadcast: Callable[[Any], Any]) -> Any:
    """The noise rules of all lanes as one tree, without noise for the first half.

    Args:
      noise: the rule.
      broadcast: adds the axis of lanes to a tree.
    """

    def halves(plain: Array, noisy: Array) -> Array:
        count = plain.shape[0] // 2
        return jnp.concatenate([plain[:count], noisy[count:]])

    return jax.tree.map(halves, broadcast(noise.scaled(0.0)), broadcast(noise))


def finite_test_loss(test_loss: Callable) -> Callable:
    """JaxPlan's batched test loss, in which a lane that diverged does not hide the others.

    JaxPlan takes a loss that is not a number for the smallest one. Here it counts as a large
    one, unless no lane has a finite loss.
    """

    @jax.jit
    def comparable(losses: Array) -> Array:
        finite = jnp.isfinite(losses)
        largest = jnp.max(jnp.where(finite, jnp.abs(losses), 0.0))
        replaced = jnp.where(finite, losses, _PENALTY * (1.0 + largest))
        return jnp.where(jnp.any(finite), replaced, losses)

    def finite(*arguments: Any) -> Any:
        losses, rest = test_loss(*arguments)
        return comparable(losses), rest

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
    entries: dict[str, Any] = {}
    on_device = {}
    for name in _BY_LANE:
        value = callback.get(name)
        if isinstance(value, np.ndarray):
            entries[name] = value[lanes]
        elif value is not None:
            on_device[name] = value
    entries.update(_select(on_device, lanes))
    entries["best_index"] = int(callback["best_index"]) % len(plain)
    return entries
