"""The presets: the paper's values, and what a domain changes in them."""

import pytest

from mdpo_rddl import AdaptiveNoise
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import DEFAULT_PRESET, PRESETS
from mdpo_rddl.planner.upstream import JaxDeepReactivePolicy


def test_the_paper_preset_holds_the_papers_values() -> None:
    """arXiv 2605.07520, section "Implementation Details"."""
    config = PRESETS["paper"]("some_domain")
    assert config.sections == {
        "Compiler": {
            "method": "DefaultJaxRDDLCompilerWithGrad",
            "argmax_weight": 100.0,
            "bernoulli_sigmoid_weight": 100.0,
            "binomial_softmax_weight": 100.0,
            "discrete_softmax_weight": 100.0,
            "floor_weight": 100.0,
            "geometric_floor_weight": 100.0,
            "poisson_comparison_weight": 100.0,
            "round_weight": 100.0,
            "sigmoid_weight": 100.0,
            "switch_weight": 100.0,
        },
        "Planner": {
            "method": "JaxDeepReactivePolicy",
            "method_kwargs": {"topology": [12, 12]},
            "optimizer": "rmsprop",
            # the decay is PyTorch's, in which the paper's code is written
            "optimizer_kwargs": {"learning_rate": 0.01, "decay": 0.99},
            "batch_size_train": 1,
            "batch_size_test": 20,
            "pgpe": None,
        },
        "Optimize": {
            "key": 0,
            "epochs": 3000,
            "train_seconds": 86400.0,
            "test_rolling_window": 5,
        },
        "Noise": {
            "method": "AdaptiveNoise",
            "sigma_min": 0.0,
            "sigma_max": 10.0,
            "alpha": 1.0,
            "quantile": 0.95,
        },
        "MDPO": {"stop_at_termination": True, "iterations_per_call": 50, "test_every": 10},
    }
    assert DEFAULT_PRESET == "auto"


@pytest.mark.parametrize("domain", ["hvac", "power_gen", "reservoir_control_cont"])
def test_a_domain_changes_only_the_presets_noise_within_the_papers_limits(domain: str) -> None:
    config, plain = PRESETS["paper"](domain), PRESETS["paper"]("some_domain")
    assert {**config.sections, "Noise": {}} == {**plain.sections, "Noise": {}}
    noise = config.noise()
    assert isinstance(noise, AdaptiveNoise)
    assert (noise.sigma_min, noise.quantile) == (0.0, 0.95)
    assert 9.0 <= noise.sigma_max <= 11.0


def test_the_preset_is_a_configuration_that_jaxplan_accepts() -> None:
    config = PRESETS["paper"]("hvac")
    assert PlannerConfig.from_text(config.to_text()).sections == config.sections
    planner_args, plan_args, _ = config.jaxplan_arguments()
    assert isinstance(planner_args["plan"], JaxDeepReactivePolicy)
    assert plan_args == {"topology": [12, 12]}
