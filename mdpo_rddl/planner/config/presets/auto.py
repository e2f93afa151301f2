"""The preset `auto`: one race for all problems, see docs/auto.md."""

from typing import Any

from mdpo_rddl.planner.config.budgets import AUTO_SECONDS
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.text import DEFAULT_COMPILER

RESTARTS = 4
_WEIGHT = 100.0
# those of JaxPlan's default compiler, listed so that no race must import it for them
_WEIGHTS = (
    "argmax_weight",
    "bernoulli_sigmoid_weight",
    "binomial_softmax_weight",
    "discrete_softmax_weight",
    "floor_weight",
    "geometric_floor_weight",
    "poisson_comparison_weight",
    "round_weight",
    "sigmoid_weight",
    "switch_weight",
)


def auto_preset(domain_name: str) -> PlannerConfig:
    """The configuration, the same for every domain.

    `[Search]` makes it one of `mdpo_rddl.race`, which fills in units and scales.
    """
    del domain_name
    sections: dict[str, dict[str, Any]] = {
        "Compiler": {
            "method": DEFAULT_COMPILER,
            **dict.fromkeys(_WEIGHTS, _WEIGHT),
        },
        "Planner": {
            "method": "FeedbackPlan",
            "method_kwargs": {
                "topology": [32, 32],
                "plan": True,
                "distant": True,
                "pairs": 100,
            },
            "optimizer": "normalized_adam",
            "optimizer_kwargs": {"learning_rate": 0.001},
            "batch_size_train": 8,
            "batch_size_test": 32,
            "parallel_updates": RESTARTS,
            "pgpe": None,
        },
        "Optimize": {
            "key": 0,
            "epochs": 1_000_000,
            "train_seconds": AUTO_SECONDS,
            "test_rolling_window": 1,
        },
        "Noise": {
            "method": "AdaptiveNoise",
            "sigma_min": 0.0,
            "sigma_max": 0.1,
            "alpha": 1.0,
            "quantile": 0.95,
            "analysis_samples": 0,
        },
        "Search": {},
        "MDPO": {"stop_at_termination": True, "iterations_per_call": 100, "test_every": 20},
    }
    return PlannerConfig(sections, "preset 'auto'")
