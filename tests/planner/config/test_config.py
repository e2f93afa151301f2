"""Configuration files: JaxPlan's own read as JaxPlan reads them, and back to text."""

import types
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from helpers.config_texts import NOISE, TEXT
from helpers.files import changed
from helpers.problems import JAXPLAN_EXAMPLES

from mdpo_rddl import AdaptiveNoise, ConstantNoise, InputError, NoNoise, load_config
from mdpo_rddl.noise import AnnealedNoise, default_noise
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.config import PlannerConfig, load_config_from_string
from mdpo_rddl.planner.config.values import optimize_parameters
from mdpo_rddl.planner.upstream import planner
from mdpo_rddl.problem.load import load_problem

EXAMPLES = JAXPLAN_EXAMPLES / "configs"
TEMPLATES = sorted(EXAMPLES.glob("tuning_*.cfg"))
CONFIGS = sorted(set(EXAMPLES.glob("*.cfg")) - set(TEMPLATES))


def assert_same(ours: Any, theirs: Any) -> None:
    """Equal where Python can tell, of the same type and contents where it cannot."""
    assert type(ours) is type(theirs)
    if isinstance(ours, dict):
        assert list(ours) == list(theirs)
        for key in ours:
            assert_same(ours[key], theirs[key])
    elif isinstance(ours, list | tuple):
        assert len(ours) == len(theirs)
        for pair in zip(ours, theirs, strict=True):
            assert_same(*pair)
    elif isinstance(ours, jax.Array | np.ndarray):
        np.testing.assert_array_equal(ours, theirs, strict=True)
    elif isinstance(ours, types.FunctionType):
        # each call of a factory makes another function around the arguments
        assert ours.__code__ is theirs.__code__
        ours_cells, theirs_cells = ours.__closure__ or (), theirs.__closure__ or ()
        for our_cell, their_cell in zip(ours_cells, theirs_cells, strict=True):
            assert_same(our_cell.cell_contents, their_cell.cell_contents)
    elif type(ours).__module__ == planner.__name__:
        assert_same(vars(ours), vars(theirs))
    else:
        assert ours == theirs


def test_there_are_example_configurations() -> None:
    assert len(CONFIGS) >= 24
    assert len(TEMPLATES) >= 3


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_jaxplans_own_configurations_give_what_jaxplan_reads(path: Path) -> None:
    planner_args, plan_args, train_args = load_config(path)
    assert_same((planner_args, plan_args, train_args), planner.load_config(str(path)))


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_a_noise_section_changes_nothing_for_jaxplan(path: Path, tmp_path: Path) -> None:
    with_noise = tmp_path / path.name
    with_noise.write_text(path.read_text() + "\n" + NOISE)
    assert_same(planner.load_config(str(with_noise)), planner.load_config(str(path)))

    planner_args, plan_args, train_args = load_config(str(with_noise))
    assert planner_args.pop("configured_noise") == AdaptiveNoise(
        sigma_max=3, alpha=0.5, unit="absolute"
    )
    assert_same((planner_args, plan_args, train_args), planner.load_config(str(path)))


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.stem)
def test_the_first_placeholder_of_a_template_is_named_with_its_line(path: Path) -> None:
    lines = path.read_text().splitlines()
    line = next(number for number, text in enumerate(lines, 1) if "_TUNE" in text)
    key, _, value = lines[line - 1].partition("=")
    with pytest.raises(InputError) as caught:
        load_config(path)
    assert str(caught.value) == (
        f"{path}:{line}: [Compiler] {key}: {value!r} is not a Python literal (is a quote missing?)"
    )


@pytest.mark.parametrize(
    ("section", "noise"),
    [
        ("[Noise]\n", AdaptiveNoise(sigma_max=10.0, unit="absolute")),
        ("[Noise]\nunit='range'\n", AdaptiveNoise()),
        ("[Noise]\nmethod='AnnealedNoise'\npaired=False\n", AnnealedNoise(paired=False)),
        ("[Noise]\nmethod='NoNoise'\n", NoNoise()),
        ("[Noise]\nmethod='ConstantNoise'\nsigma=2\n", ConstantNoise(2.0, "absolute")),
        ("[Noise]\nmethod='ConstantNoise'\nunit='range'\n", ConstantNoise(0.1, "range")),
        # with a key that no file from before the units has: the documented default, written out
        ("[Noise]\nmethod='ConstantNoise'\npaired=True\n", default_noise()),
        ("[Noise]\nmethod='ConstantNoise'\npaired=False\n", ConstantNoise()),
        ("[Noise]\npaired=True\nalpha=2\n", AdaptiveNoise(alpha=2.0, paired=True)),
        (
            "[Noise]\nmethod='ConstantNoise'\nsigma=0.1\nunit='range'\npaired=True\n",
            default_noise(),
        ),
        (
            "[Noise]\nsigma_min=1.5\nquantile=1\n",
            AdaptiveNoise(1.5, 10.0, quantile=1, unit="absolute"),
        ),
        (
            "[Noise]\nmethod='AdaptiveNoise'\nanalysis_samples=4\nregularization=1e-6\n",
            AdaptiveNoise(sigma_max=10.0, analysis_samples=4, regularization=1e-6, unit="absolute"),
        ),
    ],
)
def test_the_noise_that_a_section_describes(section: str, noise: object) -> None:
    assert load_config_from_string(TEXT + section)[0]["configured_noise"] == noise


def test_without_the_section_the_planner_is_left_its_default() -> None:
    planner_args, _, _ = load_config_from_string(TEXT)
    assert "configured_noise" not in planner_args
    assert PlannerConfig.from_text(TEXT).noise() == default_noise()


def test_a_string_gives_what_jaxplan_reads_from_it() -> None:
    planner_args, plan_args, train_args = load_config_from_string(TEXT + NOISE)
    del planner_args["configured_noise"]
    expected = planner.load_config_from_string(TEXT)
    assert_same((planner_args, plan_args, train_args), expected)
    assert plan_args["topology"] == [8]
    assert plan_args["activation"] is jax.nn.relu


def test_a_byte_order_mark_is_no_part_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "x.cfg").write_text(TEXT, encoding="utf-8-sig")
    assert PlannerConfig.from_file(tmp_path / "x.cfg").section("Optimize")["key"] == 42


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_a_configuration_survives_the_way_through_text(path: Path) -> None:
    config = PlannerConfig.from_file(path).with_section("Noise", {"alpha": 0.1 + 0.2})
    text = config.to_text()
    again = PlannerConfig.from_text(text)
    assert again.sections == config.sections
    assert again.to_text() == text
    assert again.section("Noise") == {"alpha": 0.1 + 0.2}


def test_awkward_values_survive_the_way_through_text() -> None:
    awkward = {
        "policy_hyperparams": {"a = [b] # c": 1e-300, "d\ne": 2},
        "subs": {"s": ("\u03c3", "'\"", None, True)},
    }
    config = PlannerConfig.from_text(TEXT).with_values("Optimize", **awkward)
    assert PlannerConfig.from_text(config.to_text()).sections == config.sections


def test_text_without_noise_is_the_text_of_the_other_sections() -> None:
    config = PlannerConfig.from_text(TEXT + NOISE)
    assert config.to_text(for_jaxplan=True) == PlannerConfig.from_text(TEXT).to_text()


def test_none_where_jaxplan_takes_it() -> None:
    values = "batch_size_test=None\nrollout_horizon=None\nclip_grad=None\npgpe=None"
    text = changed(TEXT + NOISE, "pgpe=None", values).replace("key=42", "key=None")
    planner_args, _, train_args = load_config_from_string(text)
    del planner_args["configured_noise"]
    expected = planner.load_config_from_string(text)
    assert_same((planner_args, train_args), (expected[0], expected[2]))


def test_changed_copies_leave_the_original_alone() -> None:
    config = PlannerConfig.from_text(TEXT, "a.cfg")
    longer = config.with_values("Optimize", epochs=7)
    assert longer.section("Optimize") == {**config.section("Optimize"), "epochs": 7}
    assert config.section("Optimize")["epochs"] == 300
    config.section("Optimize")["epochs"] = 8
    assert config.section("Optimize")["epochs"] == 300
    with pytest.raises(InputError, match=r"^a\.cfg: \[Optimize\] epochs: "):
        config.with_values("Optimize", epochs=0).checked()


def test_the_keys_of_jaxplans_controllers_are_accepted_and_not_handed_to_optimize() -> None:
    text = TEXT.replace("[Optimize]", "[Optimize]\ntrain_on_reset=True\nwarm_start=False")
    _, _, train_args = load_config_from_string(text)
    assert (train_args["train_on_reset"], train_args["warm_start"]) == (True, False)
    problem = load_problem("Reservoir_ippc2023", "1", 3)
    built = build_planner(problem, PlannerConfig.from_text(text))
    assert built.training_arguments().keys() <= optimize_parameters()
    for_controllers = {"train_on_reset", "warm_start"}
    assert train_args.keys() - built.training_arguments().keys() == for_controllers | {"key"}


def test_what_is_built_knows_its_budget_and_prints_nothing() -> None:
    text = TEXT.replace("[Optimize]", "[Optimize]\nprint_summary=True\ntest_rolling_window=3")
    built = build_planner(load_problem("Reservoir_ippc2023", "1", 3), PlannerConfig.from_text(text))
    assert built.arguments == {"test_rolling_window": 3, "policy_hyperparams": 2.0}
    assert built.budget.iterations == 300
    arguments = built.training_arguments(Budget(7, 2.0))
    assert (arguments["epochs"], arguments["train_seconds"]) == (7, 2.0)
    printed = {name: value for name, value in arguments.items() if name.startswith("print_")}
    assert printed == dict.fromkeys(("print_summary", "print_progress", "print_hyperparams"), False)


def test_a_budget_that_nobody_gives_is_jaxplan_s() -> None:
    config = PlannerConfig.from_text(TEXT).without_values("Optimize", "epochs", "train_seconds")
    assert config.budget() == Budget(999999, 120.0)
    assert config.budget(seconds=1.0).seconds == 1.0
    assert config.with_values("Optimize", train_seconds=9.0).budget(seconds=1.0).seconds == 9.0


def test_arguments_of_policy_and_optimiser_are_changed_one_by_one() -> None:
    config = PlannerConfig.from_text(TEXT).with_values(
        "Planner", method="JaxDeepReactivePolicy", method_kwargs={"topology": [3]}
    )
    other = config.with_policy_arguments(activation="relu")
    assert other.policy_arguments == {"topology": [3], "activation": "relu"}
    assert config.policy_arguments == {"topology": [3]}
    faster = config.with_optimizer_arguments(learning_rate=0.5)
    assert faster.optimizer_arguments == {**config.optimizer_arguments, "learning_rate": 0.5}
    with pytest.raises(InputError, match="unknown key 'topologi'"):
        config.with_policy_arguments(topologi=[3]).checked()


def test_sizes_of_a_call() -> None:
    text = TEXT + "\n[MDPO]\niterations_per_call=20\ntest_every=5\n"
    arguments = PlannerConfig.from_text(text).mdpo_arguments()
    assert (arguments["iterations_per_call"], arguments["test_every"]) == (20, 5)
