"""Action noise: rules for its size, its sensitivities and its draws. Knows no planner."""

from mdpo_rddl.noise.adaptive import AdaptiveNoise
from mdpo_rddl.noise.annealed import AnnealedNoise
from mdpo_rddl.noise.base import ActionNoise, NoiseProfile
from mdpo_rddl.noise.constant import ConstantNoise, NoNoise
from mdpo_rddl.noise.default import default_noise

__all__ = [
    "ActionNoise",
    "AdaptiveNoise",
    "AnnealedNoise",
    "ConstantNoise",
    "NoNoise",
    "NoiseProfile",
    "default_noise",
]
