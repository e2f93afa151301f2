"""What the value of each state on the way is to be."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax


class Decay(NamedTuple):
    """How rewards and values count that come later.

    Attributes:
      discount: of rewards, for each step.
      trace: lambda, of the rollout beside the value: 0 trusts the value, 1 the rollout.
    """

    discount: float
    trace: float


def lambda_returns(
    rewards: Array, values: Array, alive: Array, off_policy: Array, decay: Decay
) -> Array:
    """The lambda-return of each step [B, H], cut where another action was tried.

    G_t = r_t + gamma ((1 - lambda) v_{t+1} + lambda G_{t+1}), with v_{t+1} for G_{t+1} where the
    action of step t + 1 is not the policy's, as in Watkins' Q(lambda): what follows from that one
    says nothing of the policy. Nothing is expected after the end.

    Args:
      rewards: of each step, zero after the end [B, H].
      values: expected from each step on [B, H].
      alive: 1 up to the step that ends the episode, 0 after it [B, H].
      off_policy: whether the action of a step was not the policy's [B, H].
      decay: of what comes later.
    """

    def back(following: tuple[Array, Array], step: tuple[Array, ...]) -> tuple:
        value_after, return_after = following
        reward, value, lives, cut = step
        mixed = (1.0 - decay.trace) * value_after + decay.trace * return_after
        now = reward + decay.discount * mixed
        value = value * lives
        return (value, jnp.where(cut, value, now * lives)), now

    none = jnp.zeros_like(rewards[:, 0])
    steps = (rewards.T, values.T, alive.T, off_policy.T)
    return lax.scan(back, (none, none), steps, reverse=True)[1].T
