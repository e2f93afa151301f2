"""Which of JAX's random numbers each part of a race draws: none are those of another part."""

from enum import IntEnum

import jax
from jax import Array


class Draws(IntEnum):
    """The parts that draw with JAX; what one part does in turn is folded into its own key."""

    JUDGE = 1
    PLANS = 2
    PROBING = 3
    TRAINING = 5
    PGPE = 6
    POPULATION = 7
    GRADIENT = 8
    GREEDY = 10


def key_for(part: Draws, seed: int) -> Array:
    """The random key of a part of the race.

    Args:
      part: that draws.
      seed: of the race.
    """
    return jax.random.fold_in(jax.random.PRNGKey(seed), int(part))
