"""The rules that are compared, and the configurations that they are compared in."""

from typing import Any

from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.jaxplan_configs import jaxplan_config

NONE, TWICE = "none", "none-twice"

METHODS: dict[str, dict[str, Any] | None] = {
    NONE: {"method": "NoNoise"},
    TWICE: {"method": "NoNoise"},
    "constant": {"method": "ConstantNoise", "unit": "range", "sigma": 0.1},
    "default": None,
    "adaptive": {"method": "AdaptiveNoise", "unit": "range", "sigma_max": 0.1},
    "paper": {"method": "AdaptiveNoise", "unit": "absolute", "sigma_max": 10.0},
}
"""Per method its section `[Noise]`; None for the planner's default.

`none` is JaxPlan's planner. `none-twice` has twice as many parallel updates, as the default has, so
that what the default's noise adds can be told from what its second update adds.
"""


def cell_config(problem: str, plan: str, configuration: str, method: str) -> PlannerConfig:
    """JaxPlan's configuration for a problem, else its default, with a method's noise.

    Args:
      problem: name in rddlrepository.
      plan: "slp" or "drp".
      configuration: "own", or "no-pgpe" for the same without PGPE.
      method: one of `METHODS`.
    """
    config = jaxplan_config(problem, plan)
    if configuration == "no-pgpe":
        config = config.with_values("Planner", pgpe=None)
    if method == TWICE:
        count = config.section("Planner").get("parallel_updates", 1)
        config = config.with_values("Planner", parallel_updates=2 * count)
    noise = METHODS[method]
    config = config.without_section("Noise")
    return config if noise is None else config.with_section("Noise", noise)
