"""Noise that knows nothing of the model: none, or the same at every step."""

import numbers
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from mdpo_rddl.noise.base import ActionNoise, NoiseProfile
from mdpo_rddl.noise.checks import floats_only, require_bool, require_number
from mdpo_rddl.noise.units import RANGE, require_unit


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class NoNoise(ActionNoise):
    """No noise: MDPO is then JaxPlan itself, bit for bit."""

    @property
    def silent(self) -> bool:
        """True."""
        return True

    def profile(
        self, gradients: Mapping[str, Array] | None, state: Any, horizon: int
    ) -> tuple[NoiseProfile, Any]:
        """Zeros [H]."""
        zeros = jnp.zeros(horizon)
        return NoiseProfile(sigma=zeros, sensitivity=zeros), state


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ConstantNoise(ActionNoise):
    """The same noise at every step.

    Attributes:
      sigma: standard deviation, in `unit`; at least 0.
      unit: "range" or "absolute", see `ActionNoise.unit`.
      paired: see `ActionNoise.paired`.

    Raises:
      ValueError: if a value is out of range.
    """

    sigma: float = 0.1
    unit: str = field(default=RANGE, metadata={"static": True})
    paired: bool = field(default=False, metadata={"static": True})

    def __post_init__(self) -> None:
        require_unit(self.unit)
        require_number("sigma", self.sigma, at_least=0.0)
        require_bool("paired", self.paired)
        floats_only(self, but=("paired",))

    @property
    def silent(self) -> bool:
        """Whether sigma is the number 0."""
        return isinstance(self.sigma, numbers.Real) and self.sigma == 0

    def profile(
        self, gradients: Mapping[str, Array] | None, state: Any, horizon: int
    ) -> tuple[NoiseProfile, Any]:
        """`sigma` at every step [H]."""
        sigma = jnp.full(horizon, self.sigma)
        return NoiseProfile(sigma=sigma, sensitivity=jnp.zeros_like(sigma)), state
