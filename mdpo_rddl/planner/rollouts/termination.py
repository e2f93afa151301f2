"""No reward nor error after the end of an episode: JaxPlan's rollouts ignore where it ends."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jax import Array


def steps_alive(ended: Array) -> Array:
    """Which steps still count, given after which steps the episode was over.

    Args:
      ended: whether the state after each step ends the episode [B, H].

    Returns:
      1.0 for every step up to and including the first that ends it, 0.0 after it [B, H].
    """
    over = jnp.cumsum(ended, axis=1) > 0
    before = jnp.pad(over[:, :-1], ((0, 0), (1, 0)), constant_values=False)
    return jnp.where(before, 0.0, 1.0)


def stop_at_termination(rollouts: Callable) -> Callable:
    """Rollouts without rewards and errors after a termination condition or a broken invariant.

    Which step is the last is treated as constant: the gradient passes through the rewards that
    count, not through the moment of the end.

    Args:
      rollouts: as JaxPlan compiles them, with `check_constraints=True`.
    """

    def stopped(*arguments: Any) -> tuple[dict[str, Any], Any]:
        log, model_params = rollouts(*arguments)
        ended = log["termination"] | ~log["invariant"]
        alive = steps_alive(ended).astype(log["reward"].dtype)
        # a non-finite reward after the end must not survive a multiplication by zero
        rewards = {
            name: jnp.where(alive > 0.0, log[name], 0.0)
            for name in ("reward", "counted")
            if name in log
        }
        error = jnp.where(alive > 0.0, log["error"], 0)
        played = {"playable": log["playable"] | (alive == 0.0)} if "playable" in log else {}
        return {**log, **rewards, **played, "error": error}, model_params

    return stopped
