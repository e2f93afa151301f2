"""Adaptive noise in cycles that end without any, beside an update without noise."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from mdpo_rddl.noise.adaptive import AdaptiveNoise
from mdpo_rddl.noise.base import NoiseProfile
from mdpo_rddl.noise.checks import require_number


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class AnnealedNoise(AdaptiveNoise):
    """Adaptive noise whose scale falls to 0 within a cycle; each cycle is twice as long.

    At iteration n of a cycle of N the profile is that of `AdaptiveNoise` times

        (1 - n / N) ** power

    The first cycle has `cycle` iterations. No budget has to be known: whenever training ends,
    whole cycles were a third of it or more, but for budgets below the first.

    Attributes:
      cycle: iterations of the first cycle, at least 1.
      power: how fast the noise falls, above 0.
      paired: see `ActionNoise.paired`.

    The other attributes are those of `AdaptiveNoise`.

    Raises:
      ValueError: if a number is out of range.
    """

    sigma_max: float = 0.3
    cycle: float = 40.0
    power: float = 3.0
    paired: bool = field(default=True, metadata={"static": True})

    def __post_init__(self) -> None:
        require_number("cycle", self.cycle, at_least=1.0)
        require_number("power", self.power, above=0.0)
        super().__post_init__()

    def initial_state(self, horizon: int) -> Any:
        """The iterations done: a scalar."""
        del horizon
        return jnp.zeros(())

    def advance(self, state: Any) -> Any:
        """Another decision's plan is annealed from the beginning."""
        return jnp.zeros_like(state)

    def profile(
        self, gradients: Mapping[str, Array] | None, state: Any, horizon: int
    ) -> tuple[NoiseProfile, Any]:
        """The profile [H] of `AdaptiveNoise`, annealed; the state counts iterations.

        Raises:
          ValueError: if `gradients` is None.
        """
        profile, _ = super().profile(gradients, (), horizon)
        doublings = jnp.floor(jnp.log2(state / self.cycle + 1.0))
        length = self.cycle * 2.0**doublings
        done = (state - (length - self.cycle)) / length
        decay = jnp.clip(1.0 - done, 0.0, 1.0) ** self.power
        return profile._replace(sigma=decay * profile.sigma), state + 1.0
