"""The options of `mdpo-plan` that change the configuration."""

from typing import Any

import pytest
from helpers.config_texts import TEXT
from helpers.mistakes import one_line

from mdpo_rddl import AdaptiveNoise, ConstantNoise
from mdpo_rddl.cli.configure import configure
from mdpo_rddl.cli.options import plan_parser
from mdpo_rddl.noise import default_noise
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import PRESETS

WEIGHTS = [
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
]


def configured(config: PlannerConfig, options: str) -> PlannerConfig:
    arguments = ["domain.rddl", "instance.rddl", *options.split()]
    return configure(config, plan_parser().parse_args(arguments))


@pytest.mark.parametrize(
    ("options", "section", "values"),
    [
        ("", "Noise", {}),
        ("--seed 3 --horizon 9 --episodes 2 --out x --json --quiet", "Noise", {}),
        ("--preset paper", "Noise", {}),
        ("--noise adaptive", "Noise", {}),
        ("--sigma-min 1.5", "Noise", {"sigma_min": 1.5}),
        ("--sigma-max 20", "Noise", {"sigma_max": 20.0}),
        ("--sigma-min 20 --sigma-max 30", "Noise", {"sigma_min": 20.0, "sigma_max": 30.0}),
        ("--alpha 0.25", "Noise", {"alpha": 0.25}),
        ("--quantile 1", "Noise", {"quantile": 1.0}),
        ("--policy drp", "Planner", {}),
        ("--policy slp", "Planner", {"method": "JaxStraightLinePlan", "method_kwargs": {}}),
        ("--weight 7", "Compiler", dict.fromkeys(WEIGHTS, 7.0)),
        ("--iterations 5", "Optimize", {"epochs": 5}),
        ("--seconds 2.5", "Optimize", {"train_seconds": 2.5}),
        ("--restarts 3", "Planner", {"parallel_updates": 3}),
        ("--batch 4", "Planner", {"batch_size_train": 4}),
    ],
)
def test_an_option_changes_what_it_says_and_nothing_else(
    options: str, section: str, values: dict[str, Any]
) -> None:
    preset = PRESETS["paper"]("some_domain")
    expected = {**preset.sections, section: {**preset.section(section), **values}}
    assert configured(preset, options).sections == expected


@pytest.mark.parametrize(
    ("options", "noise"),
    [
        ("--noise none", {"method": "NoNoise"}),
        ("--noise constant", {"method": "ConstantNoise"}),
        ("--noise constant --sigma 2", {"method": "ConstantNoise", "sigma": 2.0}),
    ],
)
def test_another_noise_replaces_the_section(options: str, noise: dict[str, Any]) -> None:
    preset = PRESETS["paper"]("some_domain")
    config = configured(preset, options)
    assert config.sections == {**preset.sections, "Noise": noise}


def test_all_options_at_once() -> None:
    options = (
        "--noise constant --sigma 0 --policy slp --weight 1 --iterations 2 --seconds 3"
        " --restarts 4 --batch 5"
    )
    preset = PRESETS["paper"]("some_domain")
    assert configured(preset, options).sections == {
        "Compiler": {**preset.section("Compiler"), **dict.fromkeys(WEIGHTS, 1.0)},
        "Planner": {
            **preset.section("Planner"),
            "method": "JaxStraightLinePlan",
            "method_kwargs": {},
            "parallel_updates": 4,
            "batch_size_train": 5,
        },
        "Optimize": {**preset.section("Optimize"), "epochs": 2, "train_seconds": 3.0},
        "Noise": {"method": "ConstantNoise", "sigma": 0.0},
        "MDPO": preset.section("MDPO"),
    }


def test_options_on_a_file_without_noise() -> None:
    config = PlannerConfig.from_text(TEXT)
    assert configured(config, "--alpha 2").noise() == AdaptiveNoise(alpha=2.0)
    assert configured(config, "--noise constant").noise() == ConstantNoise()
    assert configured(config, "") == config  # the planner has a default


def test_options_on_a_file_with_its_own_noise() -> None:
    config = PlannerConfig.from_text(TEXT + "[Noise]\nmethod='ConstantNoise'\nsigma=3\n")
    assert configured(config, "").noise() == ConstantNoise(sigma=3, unit="absolute")
    assert configured(config, "--noise constant").noise() == ConstantNoise(3, "absolute")
    assert configured(config, "--sigma 4").noise() == ConstantNoise(4.0, "absolute")
    adaptive = AdaptiveNoise(sigma_max=10.0, unit="absolute")
    assert configured(config, "--noise adaptive").noise() == adaptive


def test_a_sigma_of_the_command_line_is_in_the_unit_of_a_section_with_paired() -> None:
    config = PlannerConfig.from_text(TEXT + "[Noise]\nmethod='ConstantNoise'\npaired=True\n")
    assert configured(config, "").noise() == default_noise()
    assert configured(config, "--sigma 0.3").noise() == ConstantNoise(0.3, paired=True)


def test_the_policy_that_a_file_has_keeps_its_arguments() -> None:
    config = PlannerConfig.from_text(TEXT)
    assert configured(config, "--policy drp").sections["Planner"] == config.sections["Planner"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--sigma 1", "--sigma needs --noise constant"),
        ("--noise none --sigma 1", "--sigma needs --noise constant"),
        ("--noise constant --sigma-min 1", "--sigma-min needs --noise adaptive"),
        ("--noise constant --sigma-max 1", "--sigma-max needs --noise adaptive"),
        ("--noise constant --alpha 1", "--alpha needs --noise adaptive"),
        ("--noise none --quantile 1", "--quantile needs --noise adaptive"),
        ("--sigma-min 11", "--sigma-min 11 is above sigma_max, 10: set --sigma-max"),
    ],
)
def test_an_option_that_does_not_go_with_the_noise(options: str, said: str) -> None:
    preset = PRESETS["paper"]("some_domain")
    assert one_line(lambda: configured(preset, options)) == said
