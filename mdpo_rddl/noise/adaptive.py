"""MDPO's adaptive noise: larger where the return is more sensitive to the action."""

import numbers
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import jax
from jax import Array

from mdpo_rddl.noise.base import ActionNoise, NoiseProfile
from mdpo_rddl.noise.checks import floats_only, require_bool, require_number
from mdpo_rddl.noise.sensitivity import normalised_sensitivity, step_sensitivity
from mdpo_rddl.noise.units import RANGE, require_unit


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class AdaptiveNoise(ActionNoise):
    """A standard deviation per step that follows the return's sensitivity to the action there.

    With s_t the mean over action fluents of the 2-norm of the return's gradient at step t,
    and q the `quantile` of s over the horizon,

        s^_t    = clip(s_t / (q + regularization), 0, 1)
        sigma_t = sigma_max + (sigma_min - sigma_max) (1 - s^_t) ** alpha

    (Aroosh and Taitler, "Model-Driven Policy Optimization in Differentiable Simulators via
    Stochastic Exploration", arXiv 2605.07520, section "Adaptive Noise Scaling"). Steps with
    a non-finite gradient count as insensitive and are left out of the quantile.

    Attributes:
      sigma_min: standard deviation where the return is insensitive, in `unit`; at least 0.
      sigma_max: standard deviation where it is most sensitive; at least `sigma_min`. The paper
        takes 9 to 11, absolute.
      alpha: shape of the map, above 0; larger values give moderate sensitivities more noise.
      quantile: which quantile of the sensitivities counts as "most sensitive", in (0, 1].
      regularization: the small lambda beside the quantile, in return per unit of action.
      analysis_samples: noise-free rollouts whose mean return is differentiated; the paper
        takes one. With 0 the update of the iteration before stands in for the analysis, where
        the plan can say how its return answered to each action (`FeedbackPlan` with a plan).
      unit: "range" or "absolute", see `ActionNoise.unit`; sensitivities are in return per unit.
      paired: see `ActionNoise.paired`.

    Raises:
      ValueError: if a number is out of range.
    """

    sigma_min: float = 0.0
    sigma_max: float = 0.1
    alpha: float = 1.0
    quantile: float = 0.95
    regularization: float = 1e-8
    analysis_samples: int = field(default=1, metadata={"static": True})
    unit: str = field(default=RANGE, metadata={"static": True})
    paired: bool = field(default=False, metadata={"static": True})

    def __post_init__(self) -> None:
        require_number("sigma_min", self.sigma_min, at_least=0.0)
        lowest = self.sigma_min if isinstance(self.sigma_min, numbers.Real) else None
        require_number("sigma_max", self.sigma_max, at_least=lowest)
        require_number("alpha", self.alpha, above=0.0)
        require_number("quantile", self.quantile, above=0.0, at_most=1.0)
        require_number("regularization", self.regularization, above=0.0)
        require_bool("paired", self.paired)
        floats_only(self, but=("analysis_samples", "paired"))
        require_unit(self.unit)
        if not isinstance(self.analysis_samples, int) or isinstance(self.analysis_samples, bool):
            raise ValueError(f"analysis_samples must be an integer, got {self.analysis_samples!r}")
        require_number("analysis_samples", self.analysis_samples, at_least=0)

    @property
    def silent(self) -> bool:
        """Whether sigma_max is the number 0."""
        return isinstance(self.sigma_max, numbers.Real) and self.sigma_max == 0

    def profile(
        self, gradients: Mapping[str, Array] | None, state: Any, horizon: int
    ) -> tuple[NoiseProfile, Any]:
        """The profile [H] that the gradients per fluent [H, *action shape] call for.

        Raises:
          ValueError: if `gradients` is None.
        """
        del horizon
        if gradients is None:
            raise ValueError(
                "adaptive noise needs the gradients of an analysis, which this plan gives "
                "by rollouts only (analysis_samples of at least 1)"
            )
        sensitivity = step_sensitivity(gradients)
        relative = normalised_sensitivity(sensitivity, self.quantile, self.regularization)
        span = self.sigma_min - self.sigma_max
        sigma = self.sigma_max + span * (1.0 - relative) ** self.alpha
        return NoiseProfile(sigma=sigma, sensitivity=sensitivity), state
