"""Configurations that no machine could plan with are refused before anything is made of them."""

import functools
from typing import Any

import pytest
from helpers.config_texts import TEXT
from helpers.files import changed
from helpers.mistakes import one_line
from helpers.toys import FOLDER, problem_from, toy

from mdpo_rddl.planner.build import build_baseline, build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.upstream import JaxBackpropPlanner

HUGE = 10**9


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("_train=4", f"_train={HUGE}", "batch_size_train: must be at most 1,000,000, got 100000"),
        ("_train=4", f"_test={HUGE}", "batch_size_test: must be at most 1,000,000, got 1000000"),
        ("_train=4", "_train=" + "9" * 90, "batch_size_train: must be at most 1,000,000, got 999"),
        ("pgpe=None", f"parallel_updates={HUGE}", "parallel_updates: must be at most 1,000,000"),
        ("pgpe=None", f"rollout_horizon={HUGE}", "rollout_horizon: must be at most 100,000, got"),
        (
            "pgpe=None",
            "parallel_updates=500000",
            "batch_size_train times parallel_updates: together at most 1,000,000 rollouts, got 2,0",
        ),
        (
            "pgpe=None",
            "pgpe_kwargs={'batch_size': 400000}",
            "batch_size_train times pgpe_kwargs batch_size: together at most 1,000,000 rollouts",
        ),
        (
            "pgpe=None",
            "pgpe_kwargs={'batch_size': 1000000000}",
            "pgpe_kwargs: batch_size must be an integer from 1 to 1,000,000, got 1000000000",
        ),
        ("pgpe=None", "pgpe_kwargs={'batch_size': 0}", "pgpe_kwargs: batch_size must be an int"),
        ("pgpe=None", "pgpe_kwargs={'batch_size': 2.0}", "pgpe_kwargs: batch_size must be an int"),
        ("[8]", "[1000000, 1000000]", "method_kwargs: topology must be integers from 1 to 65,536"),
        ("[8]", "[65536, 65536]", "method_kwargs: topology makes 4,294,967,296 parameters, at m"),
        ("[8]", "[-8]", "method_kwargs: topology must be integers from 1 to 65,536, units of a "),
        ("[8]", "[True]", "method_kwargs: topology must be integers from 1 to 65,536, units of a "),
        ("[8]", "'ab'", "method_kwargs: topology must be a list of integers, got 'ab'"),
        ("[8]", str([1] * 101), "method_kwargs: topology must have at most 100 layers, got 101"),
        (
            "{'learning_rate': 0.01}",
            "{'memory_size': 1000000000}",
            "optimizer_kwargs: memory_size must be an integer of at most 1,000, got 1000000000",
        ),
        (
            "pgpe=None",
            "pgpe_kwargs={'optimizer_kwargs_mu': {'memory_size': 'x'}}",
            "pgpe_kwargs: memory_size must be an integer of at most 1,000, got 'x'",
        ),
        (
            "pgpe=None",
            "line_search_kwargs={'max_linesearch_steps': 100000}",
            "line_search_kwargs: max_linesearch_steps must be an integer of at most 1,000, got 1",
        ),
    ],
)
def test_a_planner_that_is_too_large(old: str, new: str, said: str) -> None:
    text = changed(TEXT, old, new)
    message = one_line(lambda: PlannerConfig.from_text(text, "my.cfg"))
    assert message.startswith(f"my.cfg: [Planner] {said}")


@pytest.mark.parametrize("value", ["[1]", "'x'", "True", "{'fill': 'x'}", "{'fill': None}"])
def test_hyperparameters_are_numbers(value: str) -> None:
    text = changed(TEXT, "_hyperparams=2.0", f"_hyperparams={value}")
    assert one_line(lambda: PlannerConfig.from_text(text, "my.cfg")) == (
        "my.cfg: [Optimize] policy_hyperparams: must be a number, or a dictionary of numbers by "
        f"action, got {value}"
    )
    for right in ("None", "2", "{'fill': 1e300}"):
        PlannerConfig.from_text(changed(TEXT, "_hyperparams=2.0", f"_hyperparams={right}"))


@pytest.mark.parametrize(
    "value",
    ["3", "([1, 2], [3, 4])", "(1, 1)", "(1, 2, 3)", "('a', 'b')", "(0, 2147483648)", "(0, 1e+39)"],
)
def test_a_preprocessor_s_bounds_are_two_numbers(value: str) -> None:
    scales = "preprocessor='StaticNormalizer'\npreprocessor_kwargs={'fluent_bounds': {'x': _}}"
    text = changed(TEXT, "pgpe=None", f"pgpe=None\n{scales}")
    assert one_line(lambda: PlannerConfig.from_text(changed(text, "_}}", f"{value}}}}}"))) == (
        "configuration: [Planner] preprocessor_kwargs: fluent_bounds must be a dictionary of "
        f"two numbers by fluent, the lower one first, got {{'x': {value}}}"
    )
    PlannerConfig.from_text(changed(text, "_}}", "(-0.5, 2)}}"))


@pytest.mark.parametrize(
    ("section", "key"),
    [("Optimize", "test_rolling_window"), ("MDPO", "iterations_per_call"), ("MDPO", "test_every")],
)
def test_windows_and_calls(section: str, key: str) -> None:
    text = TEXT if section in TEXT else f"{TEXT}[{section}]\n"
    for value in ("1000000", f"{HUGE}", "9" * 30):
        wide = changed(text, f"[{section}]\n", f"[{section}]\n{key}={value}\n")
        if key == "test_every":
            wide += f"iterations_per_call={value}\n"
        if value == "1000000":
            PlannerConfig.from_text(wide)
            continue
        said = one_line(lambda wide=wide: PlannerConfig.from_text(wide, "my.cfg"))
        assert said.startswith("my.cfg: [")
        assert said.endswith(f": must be at most 1,000,000, got {value}")


def test_what_anybody_trains_with_is_accepted() -> None:
    config = PlannerConfig.from_text(changed(TEXT, "[8]", "[8192, 8192]"))
    config = config.with_values(
        "Planner", batch_size_train=16_384, batch_size_test=65_536, parallel_updates=8
    )
    assert config.with_values("Planner", rollout_horizon=100_000)


@pytest.mark.parametrize(
    ("key", "rollouts", "most"),
    [("batch_size_test", "1,000,000", "10,000"), ("batch_size_train", "100,000", "10,000")],
)
def test_what_is_too_large_for_a_problem(
    key: str, rollouts: str, most: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    @functools.wraps(JaxBackpropPlanner.__init__)  # the signature says which keys there are
    def compiled(*arguments: Any, **others: Any) -> None:
        pytest.fail("a planner was made before its sizes were looked at")

    monkeypatch.setattr(JaxBackpropPlanner, "__init__", compiled)
    values = {key: int(rollouts.replace(",", "")), "rollout_horizon": 10**5}
    config = PlannerConfig.from_text(TEXT, "my.cfg").with_values("Planner", **values)
    problem = toy("signal")
    for build in (build_planner, build_baseline):
        assert one_line(lambda build=build: build(problem, config)) == (
            f"my.cfg: [Planner] {key}: {rollouts} rollouts of 100,000 "
            f"steps, at most {most} can be planned with"
        )


def test_a_net_counts_its_inputs_and_actions() -> None:
    config = PlannerConfig.from_text(changed(TEXT, "[8]", "[65536, 2047, 1]"), "my.cfg")
    said = one_line(lambda: build_planner(toy("signal"), config))
    assert said.startswith("my.cfg: [Planner] method_kwargs: topology makes 134,")
    assert said.endswith(" parameters, at most 134,217,728 can be trained")


def test_a_long_horizon_of_the_configuration_is_bounded_as_the_instance_s() -> None:
    config = PlannerConfig.from_text(TEXT, "my.cfg").with_values("Planner", rollout_horizon=10**5)
    many = ", ".join(f"l{number}" for number in range(20_000))
    domain = (FOLDER / "quest.rddl").read_text().replace("l0, l1, l2", many)
    said = one_line(lambda: build_planner(problem_from(domain), config))
    assert said == (
        "my.cfg: [Planner] rollout_horizon: the horizon is 100,000, at most 24,977 steps can be "
        "planned for: --horizon 24977"
    )


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "weight=20",
            "weight=20\npoisson_nbins=20000",
            "[Compiler] poisson_nbins: must be at most",
        ),
        ("weight=20", "weight=20\npoisson_nbins='x'", "[Compiler] poisson_nbins: must be a positi"),
        (
            "[Optimize]",
            "[Noise]\nanalysis_samples=2000000\n[Optimize]",
            "[Noise] analysis_samples: must be at most 1,000,000, got 2000000",
        ),
        (
            "pgpe=None",
            "pgpe=None\nparallel_updates=50\n[Noise]\nanalysis_samples=100000",
            "[Planner] [Noise] analysis_samples times parallel_updates: together at most 1,000,0",
        ),
    ],
)
def test_bins_and_analysis_rollouts(old: str, new: str, said: str) -> None:
    text = changed(TEXT, old, new)
    message = one_line(lambda: PlannerConfig.from_text(text, "my.cfg"))
    assert message.startswith(f"my.cfg: {said}")


def test_the_feedback_plan_s_sizes() -> None:
    for wrong, said in (
        ("'cosines': 2000", "cosines must be an integer of at most 1,000, got 2000"),
        (f"'memory': {{'actions': {[1] * 101}}}", "memory: actions must be at most 100, got 101"),
    ):
        text = changed(
            changed(TEXT, "JaxDeepReactivePolicy", "FeedbackPlan"), "'topology': [8]", wrong
        )
        text = changed(text, ", 'activation': 'relu', 'initializer': 'normal'", "")
        message = one_line(lambda text=text: PlannerConfig.from_text(text, "my.cfg"))
        assert message == f"my.cfg: [Planner] method_kwargs: {said}"


def test_pgpe_plays_the_test_s_batch() -> None:
    text = changed(TEXT, "pgpe=None", "batch_size_test=16\npgpe_kwargs={'batch_size': 16}")
    assert PlannerConfig.from_text(changed(text, "train=4", "train=400000"))
