"""What knowing the future would add: plans that are searched, and what is told of them."""

import itertools

import jax
import numpy as np
import pytest
from helpers.lakes import preset
from helpers.toys import problem_from

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.policy.hindsight.result import Hindsight
from mdpo_rddl.policy.hindsight.search import Estimate, Incumbents, find_plans
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.problem.hindsight.bound import Bounds, EpisodeBound

# a number and a coin are guessed before they are drawn
GUESS = """
domain guess {
    pvariables {
        number : { state-fluent, real, default = 0.0 };
        heads : { state-fluent, bool, default = false };
        say : { action-fluent, real, default = 0.0 };
        bet : { action-fluent, bool, default = false };
    };
    cpfs { number' = Normal(0.0, 1.0); heads' = Bernoulli(0.5); };
    reward = -abs[number' - say] + 2.0 * (bet == heads') - 2.0;
    action-preconditions { say >= -4.0; say <= 4.0; };
}
non-fluents nf { domain = guess; }
instance one {
    domain = guess; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 3; discount = 1.0;
}
"""


@pytest.fixture(scope="module")
def policy():
    problem = problem_from(GUESS)
    config = preset(1.0).without_section("Search")
    planner = build_planner(problem, config).planner
    params = planner.plan.initializer(jax.random.PRNGKey(0), {}, None)
    params = jax.tree.map(np.zeros_like, params)
    return Policy(problem, config, planner, params, {}, seed=0)


@pytest.fixture(scope="module")
def found(policy):
    """An estimate after so many looks at the clock."""
    tick = itertools.count().__next__
    return find_plans(policy.planner, (policy.params, {}), (4, 0), 1000, tick)


def test_plans_for_known_random_numbers_come_near_the_best_return(found):
    # each number and each coin known, nothing is lost
    assert found.plan.shape == (4,)
    assert np.all(found.plan <= 0.0)
    assert found.plan.mean() > -0.5
    assert found.policy.mean() < -2.0


def test_a_plan_takes_the_place_of_one_that_returns_less():
    plans = {"say": np.zeros((2, 1, 1))}
    best = Incumbents(plans, np.array([-1.0, -2.0]))
    others = {"say": np.array([[[[1.0]], [[2.0]]], [[[3.0]], [[4.0]]]])}
    best.take(others, np.array([[-3.0, -1.5], [np.nan, -1.8]]))
    assert plans["say"].ravel().tolist() == [0.0, 2.0]
    assert best.returns.tolist() == [-1.0, -1.5]


@pytest.mark.long
def test_a_policy_tells_both(policy):
    hindsight = policy.hindsight(episodes=2, seconds=1e-3)
    figures = hindsight.to_json()
    assert figures["bound"] is None
    assert figures["note"]
    assert figures["estimate"]["scenarios"] == 2
    with pytest.raises(InputError, match="episodes must be at least 1, got 0"):
        policy.hindsight(episodes=0)
    with pytest.raises(InputError, match="seconds must be a number above 0, got -1"):
        policy.hindsight(seconds=-1)


def test_the_figures_compare_episode_by_episode():
    estimate = Estimate(np.array([-4.0, -2.0]), np.array([-1.0, -1.0]), 3.0)
    bounds = Bounds((EpisodeBound(-5.0, -3.0, -3.0), EpisodeBound(-5.0, -4.0, -1.0)), "why")
    hindsight = Hindsight(estimate, bounds)
    figures = hindsight.to_json()
    assert figures["estimate"]["gain"] == 2.0
    assert figures["estimate"]["plan_returns"] == [-1.0, -1.0]
    assert figures["bound"]["bound_mean_return"] == -2.0
    assert figures["bound"]["policy_mean_return"] == -5.0
    assert figures["bound"]["attained"] == 1
    low, high = figures["bound"]["gain_ci95"]
    assert low < 3.0 < high
    assert figures["note"] == "why"
    shown = hindsight._repr_html_()
    assert "-2.00" in shown
    assert "why" in shown
    assert Hindsight(None, Bounds((), "none")).to_json()["estimate"] is None
    unbounded = Estimate(np.array([-np.inf]), np.array([-1.0]), 1.0)
    assert Hindsight(unbounded, Bounds(())).to_json()["estimate"] is None
