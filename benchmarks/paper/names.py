"""The names that the command line offers, for those who import no JAX."""

from typing import Any

PPO, JAXPLAN, ADAPTIVE = "ppo", "jaxplan", "adaptive"
METHODS = (PPO, "deterministic", JAXPLAN, "constant-1", "constant-3", ADAPTIVE)
"""In the order of the paper's table."""

SENSITIVITY_SETTINGS = ("hvac10", "powergen7", "reservoir15")
BASE, ENTRY, WEIGHT = "as in the table", "noise enters", "relaxation weight"
AFTER = "after the projection"
ACTIVATION = "activation"
FACTORS: dict[str, tuple[Any, ...]] = {
    "alpha": (0.25, 1.0, 4.0),
    "sigma_max": (3.0, 10.0, 30.0),
    "sigma_min": (0.1, 1.0),
    "quantile": (0.5, 0.8, 1.0),
    "analysis_samples": (4, 16),
    ENTRY: (AFTER,),
    WEIGHT: (1.0, 10.0, 1000.0),
    "decay": (0.9, 0.99),
    ACTIVATION: ("relu",),
    "initializer": ("glorot_uniform",),
}
"""Per factor, the values that are tried; every setting has another choice in the table."""
