"""Action noise: rules for its size, its sensitivities and its draws. Knows no planner."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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

_SOURCES = {
    "adaptive": ("AdaptiveNoise",),
    "annealed": ("AnnealedNoise",),
    "base": ("ActionNoise", "NoiseProfile"),
    "constant": ("ConstantNoise", "NoNoise"),
    "default": ("default_noise",),
}


def __getattr__(name: str) -> Any:
    """Imports a rule, and JAX with it, when it is first asked for."""
    for module, names in _SOURCES.items():
        if name in names:
            return getattr(importlib.import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
