"""The recipe of the preset `auto` on problems that compile fast."""

import dataclasses
import json
import math
import threading

import jax
import numpy as np
import pytest
from helpers.plan_command import refuse, run, write_problem
from helpers.problems import tiny_files, write_corridor

from mdpo_rddl.auto import plan_automatically, probing, recipe, sizes
from mdpo_rddl.auto.arms import gradient as descent
from mdpo_rddl.auto.arms import jaxplan as alternatives
from mdpo_rddl.auto.fitting import scaled, without_scales
from mdpo_rddl.auto.judge import Choice
from mdpo_rddl.bench.common.records import Records
from mdpo_rddl.bench.presets.auto import COLUMNS, KEYS, auto_table, run_auto
from mdpo_rddl.bench.presets.auto_variants import VARIANTS
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.background import run_until
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.problem.load import load_problem

# a lake whose pump has no bound: its unit must be found
LAKE_DOMAIN = """
domain lake {
    pvariables {
        depth : { state-fluent, real, default = 500.0 };
        pump : { action-fluent, real, default = 0.0 };
    };
    cpfs { depth' = depth + pump + Normal(0.0, 25.0); };
    reward = -abs[depth - 800.0] - 0.001 * pow[pump, 2];
}
"""
LAKE_INSTANCE = """
non-fluents nf { domain = lake; }
instance one {
    domain = lake; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 8; discount = 1.0;
}
"""


def preset(seconds: float, **search: object):
    config = auto_preset("toy").with_values("Optimize", train_seconds=seconds)
    config = config.with_values("Search", **{"alternatives": False, **search})
    return config.with_values("Planner", batch_size_train=2, batch_size_test=2, parallel_updates=2)


@pytest.fixture
def lake(tmp_path):
    domain, instance = tmp_path / "d.rddl", tmp_path / "i.rddl"
    domain.write_text(LAKE_DOMAIN)
    instance.write_text(LAKE_INSTANCE)
    return load_problem(str(domain), str(instance))


@pytest.fixture
def no_gradient(monkeypatch):
    def refuse_to_train(*arguments, **keywords):
        raise InputError("this model has no gradient")

    monkeypatch.setattr(descent, "train", refuse_to_train)
    # however slow the machine
    monkeypatch.setattr(descent, "_SHORTEST_SECONDS", -1e9)
    monkeypatch.setattr(recipe._Recipe, "_has_time_for_the_gradient", lambda *arguments: True)


def test_probing_finds_units_and_scales(lake):
    found = probing.probe(build_planner(lake, without_scales(preset(1.0))).planner, seed=0)
    # 300 above, in a few steps
    assert 10.0 <= found.units["pump"] <= 320.0
    center, scale = found.state_scales["depth"]
    assert 200.0 < center < 1200.0
    assert 1.0 < scale < 5000.0
    assert found.start_return >= found.nothing
    assert found.policy_seconds is None
    plan = build_planner(lake, scaled(preset(1.0), found)).planner.plan
    assert isinstance(plan, FeedbackPlan)
    assert plan.units["pump"] == pytest.approx(found.units["pump"], rel=1e-3)


def test_the_recipe_finds_a_good_policy(lake, monkeypatch):
    # however slow the machine
    monkeypatch.setattr(descent, "_SHORTEST_SECONDS", -1e9)
    monkeypatch.setattr(recipe._Recipe, "_has_time_for_the_gradient", lambda *arguments: True)
    monkeypatch.setattr(recipe, "run_until", lambda task, until: run_until(task, math.inf))
    result = plan_automatically(lake, preset(20.0, shared_until=0.4, own_until=0.5), seed=0)
    returns = result.diagnostics["returns"]
    best = returns[result.diagnostics["chosen"]]
    # 300 below at all 8 steps; a constant halves it, and feedback does better
    assert returns["nothing"] == pytest.approx(-2400.0, rel=0.05)
    assert best >= returns["constant"] > -1500.0
    assert result.training.iterations > 0
    assert result.training.sigma.shape == (len(result.training.history), 8)
    assert "Search" not in result.config.sections
    json.dumps(result.diagnostics, allow_nan=False)


def test_without_a_gradient_the_search_has_to_do(lake, no_gradient, caplog):
    result = plan_automatically(lake, preset(5.0), seed=0)
    assert result.diagnostics["phases"] == []
    assert result.training.status == "no_gradient"
    returns = result.diagnostics["returns"]
    assert returns[result.diagnostics["chosen"]] > returns["nothing"]
    assert "this model has no gradient" in caplog.text


def test_where_nothing_earns_anything_it_explores(tmp_path, monkeypatch):
    rules = []

    def shared(self, until):
        rules.append(until)
        return self._params

    monkeypatch.setattr(recipe.FeedbackSearch, "shared", shared)
    problem = write_corridor(tmp_path)
    for seconds in (8.0, 60.0):  # however slow the machine
        rules.clear()
        result = plan_automatically(problem, preset(seconds), seed=0)
        if result.diagnostics["returns"]["plan"] > 90.0:
            break
    # a rule is not needed once a plan has earned something that does not depend on chance
    assert not rules
    assert result.diagnostics["returns"]["constant"] <= 0.0
    assert result.diagnostics["returns"]["plan"] > 90.0
    assert result.diagnostics["chosen"] in {"plan", "polished"}
    assert result.diagnostics["search_iterations"]["plan"] > 10


def test_where_exploring_finds_nothing_feedback_is_tried(tmp_path, monkeypatch):
    monkeypatch.setattr(recipe.PlanSearch, "search", lambda self, params, **arguments: params)
    result = plan_automatically(write_corridor(tmp_path), preset(6.0), seed=0)
    returns = result.diagnostics["returns"]
    assert {"plan", "shared weights", "polished"} <= set(returns)


def test_where_plans_are_too_large_there_is_none(lake, no_gradient, monkeypatch):
    bare = build_planner(lake, without_scales(preset(1.0))).planner
    assert sizes.plans_fit(bare)
    monkeypatch.setattr(sizes, "_PLANS_BYTES", 8 * 4 * sizes.PLANS - 1)
    result = plan_automatically(lake, preset(4.0), seed=0)
    assert "plan" not in result.diagnostics["returns"]
    # then nothing but rollouts can say how the return answers to an action
    assert result.config.section("Noise")["analysis_samples"] == 1
    assert result.config.section("Planner")["method_kwargs"]["plan"] is False


def test_a_gradient_that_takes_too_long_is_given_up(lake, monkeypatch, caplog):
    released = threading.Event()

    def slow(*arguments, work, **keywords):
        released.wait(120.0)
        work.raise_if_cancelled()

    monkeypatch.setattr(recipe, "descend", slow)
    monkeypatch.setattr(recipe._Recipe, "_has_time_for_the_gradient", lambda *arguments: True)
    try:
        result = plan_automatically(lake, preset(6.0), seed=0)
    finally:
        released.set()
    assert "the gradient is given up" in caplog.text
    assert result.diagnostics["returns"]["polished"] > result.diagnostics["returns"]["nothing"]


def test_a_better_alternative_is_taken(lake, no_gradient, monkeypatch):
    config = alternatives.own_config("default", "slp").with_section("Noise", {"method": "NoNoise"})
    training = descent.Descent().result(*[{"pump": np.zeros((8,))}] * 2, 8, 0.0)
    better = alternatives.Alternative("JaxPlan's default slp", config, training, 1e6, 1.0)
    worse = dataclasses.replace(better, mean=-1e6)
    for given, is_taken in ((better, True), (worse, False), (None, False)):
        monkeypatch.setattr(recipe.Alternatives, "best", lambda self, until, one=given: one)
        result = plan_automatically(lake, preset(3.0), seed=0)
        assert (result.diagnostics["chosen"] == better.name) == is_taken
        assert (result.config is config) == is_taken


def test_an_interrupt_keeps_the_best_policy_so_far(lake, monkeypatch):
    def interrupted(*arguments, **keywords):
        raise KeyboardInterrupt

    monkeypatch.setattr(recipe, "FeedbackSearch", interrupted)
    result = plan_automatically(lake, preset(3.0), seed=0)
    assert result.diagnostics["chosen"] in {"nothing", "constant"}
    monkeypatch.setattr(recipe._Recipe, "run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        plan_automatically(lake, preset(3.0), seed=0)


def test_a_return_that_is_no_number_loses(lake):
    planner = build_planner(lake, without_scales(preset(1.0))).planner
    choice = Choice(planner, 2, seed=0)
    assert choice.take("broken", "a", float("nan"), float("nan"))
    assert choice.take("bad", "b", -5.0, 1.0)
    assert not choice.take("broken", "c", float("nan"), 0.0)
    assert (choice.name, choice.best_mean, choice.best_error) == ("bad", -5.0, 1.0)


def test_what_jaxplan_cannot_compile_is_one_line(lake, monkeypatch):
    def broken(*arguments, **keywords):
        raise AttributeError("module has no attribute\n'distributions'")

    monkeypatch.setattr(recipe, "probe", broken)
    with pytest.raises(InputError, match=r"i\.rddl: cannot be planned: .*no attribute 'dist"):
        plan_automatically(lake, preset(3.0), seed=0)


def test_an_enum_action_is_boxed_by_its_own_values():
    problem = load_problem("Sokoban_arcade", "0")
    planner = build_planner(problem, without_scales(preset(1.0))).planner
    found = probing.probe(planner, seed=0)
    # it has a box, so that none is probed; its unit is the box's width
    assert found.units == {}
    (name,) = planner.action_specs
    values = len(problem.model.type_to_objects[problem.model.action_ranges[name]])
    assert values > 2
    np.testing.assert_array_equal(planner.plan.units[name], values - 1)


def test_a_problem_too_large_to_search_gets_the_best_constant(lake, monkeypatch):
    monkeypatch.setattr(probing, "is_large", lambda planner: True)
    monkeypatch.setattr(recipe, "_FEWEST_POLICIES", 10**9)
    result = plan_automatically(lake, preset(5.0), seed=0)
    assert result.diagnostics["chosen"] == "constant"
    assert result.diagnostics["search_iterations"] == {"shared": 0, "own": 0, "plan": 0}
    assert result.diagnostics["returns"]["constant"] >= result.diagnostics["returns"]["nothing"]


# --- the command ---------------------------------------------------------------------------


def test_mdpo_plan_has_it_by_default_and_plays_it_again(tmp_path, monkeypatch, capsys):
    write_problem(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("mdpo_rddl.auto.arms.jaxplan.usable_cores", lambda: 1)
    options = "tanks.rddl two.rddl --episodes 3 --json --quiet"
    summary = run(f"{options} --seconds 8 --out run", capsys).summary
    assert summary["config"] == "auto"
    assert summary["policy"] == "feedback"
    assert summary["auto"]["returns"]["nothing"] < summary["mean_return"]
    again = run(f"{options} --load run", capsys).summary
    assert again["returns"] == summary["returns"]


@pytest.mark.parametrize("option", ["--policy slp", "--noise none", "--iterations 5", "--replan"])
def test_options_for_one_training_do_not_go_with_it(option, tmp_path, monkeypatch, capsys):
    write_problem(tmp_path)
    monkeypatch.chdir(tmp_path)
    said = f"{option.split()[0]} does not go with --preset auto, which chooses it"
    refuse(f"tanks.rddl two.rddl --preset auto {option}", said, tmp_path, capsys)


# --- the measurement -----------------------------------------------------------------------


def test_the_measurement_goes_on_and_its_table_compares(tmp_path, monkeypatch):
    out = tmp_path / "auto"
    records = run_auto(out, ["powergen7"], ["expert"], seeds=2, seconds=1.0, episodes=2)
    assert [row["planner"] for row in records.rows] == ["expert"]
    monkeypatch.setattr("mdpo_rddl.bench.presets.auto.expert", None)  # nothing is played again
    again = run_auto(out, ["powergen7"], ["expert"], seeds=2, seconds=1.0, episodes=2)
    assert again.rows == records.rows
    with pytest.raises(InputError, match="unknown problem 'powergen8'"):
        run_auto(out, ["powergen8"], ["expert"], seeds=1, seconds=1.0, episodes=2)


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_variant_is_a_configuration_of_its_own(variant, lake):
    config = VARIANTS[variant](auto_preset("toy")).without_section("Search")
    found = probing.Probe({"pump": 1.0}, {"depth": (0.0, 1.0)}, 0.0, {}, 0.0, False, None)
    planner = build_planner(lake, scaled(config, found)).planner
    assert isinstance(planner.plan, FeedbackPlan)
    others = [change(auto_preset("toy")) for name, change in VARIANTS.items() if name != variant]
    assert VARIANTS[variant](auto_preset("toy")) not in others


def test_the_table_worked_by_hand(tmp_path):
    records = Records(tmp_path / "runs.csv", COLUMNS, KEYS)
    records.add("p", "expert", 0, 2.0, "", 0.0, "", "[1.0, 3.0]")
    records.add("p", "auto", 0, 4.0, 4.0, 9.0, "polished", "[3.0, 5.0]")
    records.add("p", "auto", 1, 6.0, 6.0, 9.0, "polished", "[5.0, 7.0]")
    expert, auto = auto_table(records).splitlines()[2:]
    # 3 on both episodes, over two seeds
    assert expert == "| p | expert | 1 | 2.00 | 2.00 | 2.00 | 3.00 [3.00, 3.00] | yes |"
    assert auto == "| p | auto | 2 | 5.00 | 4.00 | 5.00 |  |  |"


def test_the_same_seed_starts_the_same_search(tmp_path):
    problem = load_problem(*tiny_files(tmp_path))
    one, two = (
        probing.probe(build_planner(problem, without_scales(preset(1.0))).planner, seed=0)
        for _ in range(2)
    )
    assert one.state_scales == two.state_scales
    jax.tree.map(np.testing.assert_array_equal, one.start, two.start)
