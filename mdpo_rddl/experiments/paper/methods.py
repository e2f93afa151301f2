"""The methods that the paper compares, each as a configuration."""

from typing import Any

from mdpo_rddl.jaxplan.config import PlannerConfig
from mdpo_rddl.presets import PRESETS

PPO, JAXPLAN, ADAPTIVE = "ppo", "jaxplan", "adaptive"
METHODS = (PPO, "deterministic", JAXPLAN, "constant-1", "constant-3", ADAPTIVE)
"""In the order of the paper's table."""

_NOISES: dict[str, dict[str, Any]] = {
    "deterministic": {"method": "NoNoise"},
    "constant-1": {"method": "ConstantNoise", "sigma": 1.0},
    "constant-3": {"method": "ConstantNoise", "sigma": 3.0},
}


def method_config(domain_name: str, method: str, seeds: int) -> PlannerConfig:
    """What a method trains with: the paper preset, with its own noise.

    PPO and JaxPlan take net, initial weights, optimiser and budget from it.

    Args:
      domain_name: how the RDDL file names the domain.
      method: one of `METHODS`.
      seeds: policies that are trained side by side.
    """
    config = PRESETS["paper"](domain_name)
    # what the planners test on the way decides nothing: the iterates are evaluated afterwards
    config = config.with_values("Planner", parallel_updates=seeds, batch_size_test=1)
    if method == ADAPTIVE:
        return config
    return config.with_section("Noise", _NOISES.get(method, {"method": "NoNoise"}))
