"""No parameters that are no numbers: JaxPlan keeps what an update leaves, and may prefer it.

A gradient may be no number where the return is one, as that of a branch which is not taken, and a
policy without numbers may be played to a return that is one, as where a comparison with them is
false.
"""

import logging
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

logger = logging.getLogger(__name__)

# advances with the iterations, lost or not
_NOISE = "noise"


def finite_lanes(*trees: Any) -> Array:
    """Of which lanes all numbers are finite [R], of trees with a leading axis of lanes."""
    leaves = [leaf for leaf in jax.tree.leaves(trees) if jnp.issubdtype(leaf.dtype, jnp.inexact)]
    finite = [jnp.all(jnp.isfinite(leaf.reshape(len(leaf), -1)), axis=1) for leaf in leaves]
    return jnp.all(jnp.stack(finite), axis=0)


_compiled = jax.jit(finite_lanes)


def are_finite(params: Any) -> np.ndarray:
    """The same of parameters, as numpy has it."""
    return np.asarray(_compiled(params))


def without_lost_updates(update: Callable) -> Callable:
    """An update that leaves a lane as it was where it would leave it without finite numbers.

    Args:
      update: with the arguments and results of JaxPlan's batched update.
    """

    def update_or_keep(*arguments: Any) -> Any:
        params, opt_state, opt_aux = arguments[1], *arguments[-2:]
        results = update(*arguments)
        is_finite = finite_lanes(results[0], results[5]["grad"])

        def kept(new: Any, old: Any) -> Any:
            def choose(one: Array, other: Array) -> Array:
                return jnp.where(is_finite.reshape(-1, *[1] * (one.ndim - 1)), one, other)

            return jax.tree.map(choose, new, old)

        new_aux = {
            name: value if name == _NOISE else kept(value, opt_aux[name])
            for name, value in results[3].items()
        }
        return (
            kept(results[0], params),
            results[1],
            kept(results[2], opt_state),
            new_aux,
            *results[4:],
        )

    return update_or_keep


class FiniteBest:
    """The best iterate of a loop of JaxPlan's that has finite numbers.

    While JaxPlan's own has them it is JaxPlan's. Else it is the best of those that do, chosen as
    JaxPlan chooses, and the initial parameters before the first, whose return is not known.
    """

    def __init__(self, initial: Callable[[], Any]) -> None:
        """Nothing is known yet.

        Args:
          initial: gives the parameters before the first update, with the axis of lanes.
        """
        self._initial = initial
        self._is_theirs, self._seen = True, -np.inf
        self._best: dict[str, Any] = {}

    def complete(self, callback: dict[str, Any]) -> None:
        """Replaces the best iterate of a callback, in place, where it has no finite numbers."""
        best_return = float(callback["best_return"])
        if best_return != self._seen:
            self._seen, is_theirs = best_return, _is_finite(callback["best_params"])
            if self._is_theirs and not is_theirs:
                logger.warning(
                    "the best parameters of iteration %d are not finite: the best finite ones are"
                    " kept",
                    callback["iteration"],
                )
            self._is_theirs = is_theirs
        if self._is_theirs:
            names = "best_params", "best_grad", "best_return", "best_index"
            self._best = {name: callback[name] for name in (*names, "last_iteration_improved")}
            return
        self._improve(callback)
        callback.update(self._best)

    def _improve(self, callback: dict[str, Any]) -> None:
        if not self._best:
            first = jax.tree.map(lambda leaf: leaf[0], self._initial())
            none = {"best_params": first, "best_grad": jax.tree.map(jnp.zeros_like, first)}
            numbers = {"best_return": -np.inf, "best_index": 0, "last_iteration_improved": 0}
            self._best = {**none, **numbers}
        returns = np.asarray(callback["test_return"])
        is_comparable = are_finite(callback["params"]) & np.isfinite(returns)
        returns = np.where(is_comparable, returns, -np.inf)
        lane = int(np.argmax(returns))
        if returns[lane] > self._best["best_return"]:
            trees = {"best_params": callback["params"], "best_grad": callback["grad"]}
            self._best = {
                **jax.tree.map(lambda leaf: leaf[lane], trees),
                "best_return": returns[lane],
                "best_index": lane,
                "last_iteration_improved": callback["iteration"],
            }


def _is_finite(tree: Any) -> bool:
    return all(np.isfinite(np.asarray(leaf)).all() for leaf in jax.tree.leaves(tree))
