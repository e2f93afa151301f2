"""What constant actions on the exact model show."""

import dataclasses

import jax
import numpy as np
import pytest
from helpers.lakes import preset, write_lake
from helpers.probes import probed
from helpers.problems import tiny_files
from helpers.toys import problem_from, toy

from mdpo_rddl.auto.common import sizes
from mdpo_rddl.auto.probing import probing
from mdpo_rddl.planner.config.fitting import scaled, without_plan, without_scales
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.problem.load import load_problem


@pytest.fixture(scope="module")
def lake(tmp_path_factory):
    return write_lake(tmp_path_factory.mktemp("lake"))


def test_probing_finds_units_and_scales(lake):
    seen = probed(build_planner(lake, without_scales(preset(1.0))).planner, seed=0)
    # 300 above, in a few steps
    assert 10.0 <= seen.units["pump"] <= 320.0
    center, scale = seen.state_scales["depth"]
    assert 200.0 < center < 1200.0
    assert 1.0 < scale < 5000.0
    # 300 below at all 8 steps
    assert seen.noop_return == pytest.approx(-2400.0, rel=0.1)
    assert seen.start_return > seen.noop_return
    assert not seen.deterministic
    assert seen.policy_seconds is None
    plan = build_planner(lake, scaled(preset(1.0), seen)).planner.plan
    assert isinstance(plan, FeedbackPlan)
    assert plan.units["pump"] == pytest.approx(seen.units["pump"], rel=1e-3)


SHOP = """
domain shop {
    requirements = { reward-deterministic };
    pvariables {
        stock : { state-fluent, real, default = 0.0 };
        make : { action-fluent, real, default = 0.0 };
        ship : { action-fluent, real, default = 0.0 };
    };
    cpfs { stock' = 100.0 * make; };
    reward = - abs[30.0 - if (ship <= 100.0 * make) then ship else 0.0];
    action-preconditions { make >= 0.0; make <= 1.0; ship >= 0.0; };
}
non-fluents few { domain = shop; }
instance today {
    domain = shop;
    non-fluents = few;
    max-nondef-actions = pos-inf;
    horizon = 3;
    discount = 1.0;
}
"""


def test_a_unit_is_found_that_shows_beside_another_action_only():
    # nothing is shipped of an empty stock, and no-op and all is one beyond it
    planner = build_planner(problem_from(SHOP), without_scales(preset(1.0))).planner
    seen = probed(planner, seed=0)
    assert 10.0 < seen.units["ship"] < 60.0
    assert seen.start_return > -30.0 * 3 / 2
    # nothing is drawn
    assert seen.deterministic
    assert seen.certain


def test_a_large_problem_is_probed_for_a_while_only(lake, monkeypatch):
    monkeypatch.setattr(probing, "is_large", lambda planner: True)
    planner = build_planner(lake, without_scales(preset(1.0))).planner
    times = iter([*range(0, 10, 5), *range(20, 10**6, 5)])
    seen = probed(planner, 0, until=22.0, clock=lambda: float(next(times)))
    assert seen.policy_seconds == 5.0
    assert seen.start_return >= seen.noop_return


def test_only_a_number_without_a_box_has_a_unit_to_find():
    problem = load_problem("Sokoban_arcade", "0")
    planner = build_planner(problem, without_scales(preset(1.0))).planner
    assert probed(planner, seed=0).units == {}
    # an enum's is its box
    assert set(planner.plan.units) <= set(problem.model.action_fluents)
    for (lower, upper), name in ((planner.plan.bounds[n], n) for n in planner.plan.units):
        np.testing.assert_array_equal(planner.plan.units[name], np.asarray(upper) - lower)


def test_plans_fit_unless_they_are_too_large(lake, monkeypatch):
    bare = build_planner(lake, without_scales(preset(1.0))).planner
    assert sizes.plans_fit(bare)
    monkeypatch.setattr(sizes, "_PLANS_BYTES", 8 * 4 * sizes.PLANS - 1)
    assert not sizes.plans_fit(bare)
    # then only rollouts can say how the return answers to an action
    config = without_plan(preset(1.0))
    assert config.section("Noise")["analysis_samples"] == 1
    assert config.section("Planner")["method_kwargs"]["plan"] is False


def test_the_same_seed_starts_the_same_search(tmp_path):
    problem = load_problem(*tiny_files(tmp_path))
    one, two = (
        probed(build_planner(problem, without_scales(preset(1.0))).planner, seed=0)
        for _ in range(2)
    )
    assert one.state_scales == two.state_scales
    jax.tree.map(np.testing.assert_array_equal, one.start, two.start)


def test_what_a_batch_takes_is_known_where_one_shows_all():
    planner = build_planner(toy("quest"), without_scales(preset(1.0))).planner
    assert probed(planner, seed=0).batch_seconds > 0.0


def test_where_rollouts_take_long_there_are_as_many_as_there_is_time_for():
    one = probing.Probe({}, {}, 0.0, {}, 0.0, False, False, None)
    assert one.judge_rollouts(128, 60.0) == 128
    # a twentieth of the time may be one candidate's
    assert dataclasses.replace(one, batch_seconds=2.9).judge_rollouts(128, 60.0) == 128
    assert dataclasses.replace(one, batch_seconds=17.0).judge_rollouts(128, 60.0) == 16
    # on large problems a hundredth
    large = [dataclasses.replace(one, policy_seconds=seconds) for seconds in (1e-6, 0.05, 5.0)]
    assert [each.judge_rollouts(128, 60.0) for each in large] == [128, 8, 2]
    # without chance
    assert dataclasses.replace(large[0], deterministic=True).judge_rollouts(128, 60.0) == 2


def test_the_scale_of_a_state_that_runs_away_is_that_of_its_first_steps():
    random = np.random.default_rng(0)
    growth = np.exp(np.linspace(0.0, 20.0, 50))
    running = [(3.0 + random.normal(size=(8, 4, 1)) * growth).astype(np.float32)]
    center, scale = probing._scale(running)
    assert center == pytest.approx(3.0, abs=1.0)
    assert 30.0 < scale < 300.0  # its deviation is 2 in the first steps, 1e8 in the last
    # what grows as a square is told as it is
    squares = [(random.normal(size=(8, 4, 1)) * np.arange(50.0) ** 2).astype(np.float32)]
    assert probing._scale(squares)[1] > 500.0
    # as is what is still in the first steps
    late = [running[0] * (np.arange(50) > 10)]
    assert probing._scale(late)[1] > 1e4
