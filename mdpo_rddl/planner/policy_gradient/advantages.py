"""How much better each action was than expected."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

# of advantages in units of the returns' scale: smaller ones are rounding errors
_NO_SPREAD = 1e-3


class Decay(NamedTuple):
    """How rewards and errors count that come later.

    Attributes:
      discount: of rewards, for each step.
      trace: lambda, of the critic's errors beside it: 0 trusts the critic, 1 the rollout.
    """

    discount: float
    trace: float


def advantages(rewards: Array, values: Array, alive: Array, decay: Decay) -> Array:
    """Generalised advantages [B, H].

    Schulman et al. (2016), https://arxiv.org/abs/1506.02438, for a finite horizon: nothing is
    expected after the last step or after the end of an episode.

    Args:
      rewards: of each step, zero after the end [B, H].
      values: expected from each step on [B, H].
      alive: 1 up to the step that ends the episode, 0 after it [B, H].
      decay: of what comes later.
    """
    after = _next(values) * _next(alive)
    errors = rewards + decay.discount * after - values
    factors = decay.discount * decay.trace * _next(alive)

    def back(later: Array, step: tuple[Array, Array]) -> tuple[Array, Array]:
        error, factor = step
        now = error + factor * later
        return now, now

    none = jnp.zeros_like(errors[:, 0])
    return lax.scan(back, none, (errors.T, factors.T), reverse=True)[1].T


def returns_from(rewards: Array, discount: float) -> Array:
    """The return from each step on [B, H], of rewards [B, H]."""
    certain = Decay(discount, 1.0)
    return advantages(rewards, jnp.zeros_like(rewards), jnp.ones_like(rewards), certain)


def normalised(values: Array, alive: Array) -> Array:
    """Values [B, H] with mean 0 and, unless all are alike, variance 1 over the steps that count."""
    share = alive / jnp.mean(alive)
    centred = values - jnp.mean(values * share)
    return centred / (jnp.sqrt(jnp.mean(centred**2 * share)) + _NO_SPREAD)


def _next(values: Array) -> Array:
    return jnp.pad(values[:, 1:], ((0, 0), (0, 1)))
