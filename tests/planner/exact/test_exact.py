"""Policies side by side on the exact model: what the numpy environment would pay them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import tiny_files
from helpers.toys import problem_from, toy, toy_text

from mdpo_rddl.planner.exact.exact import compile_exact_returns, compile_visits, step_bytes
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.planner.plans.legal import may_leave_none
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.evaluation import LOST, evaluate, lost_worth
from mdpo_rddl.problem.load import load_problem, make_environment

KEY = jax.random.PRNGKey(0)

CAR_DOMAIN = """
domain car {
    pvariables {
        x : { state-fluent, real, default = 0.0 };
        push : { action-fluent, real, default = 0.0 };
    };
    cpfs { x' = x + push; };
    reward = x;
    action-preconditions { push >= 0.0; push <= 1.0; };
    termination { x >= 2.0; };
}
"""
CAR_INSTANCE = """
non-fluents nf { domain = car; }
instance one {
    domain = car; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 6; discount = 0.5;
}
"""


def make(problem):
    arguments = {"pgpe": None, "batch_size_train": 1, "batch_size_test": 2}
    return MDPOPlanner(problem.model, FeedbackPlan(FeedbackShape(topology=None)), **arguments)


def with_biases(planner, *biases):
    """Policies of constant raw actions, one after another."""
    params = planner.plan.initializer(KEY, {}, None)

    def one(value):
        return jax.tree.map(lambda leaf: leaf, params) | {
            "own": {
                name: {**own, "bias": jnp.full_like(own["bias"], value)}
                for name, own in params["own"].items()
            }
        }

    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *map(one, biases))


def test_the_returns_are_the_environments(tmp_path):
    problem = load_problem(*tiny_files(tmp_path))
    planner = make(problem)
    policies = with_biases(planner, 0.0, 0.1)
    returns = np.asarray(compile_exact_returns(planner, 3)(KEY, policies))
    assert returns.shape == (2, 3)
    for number in range(2):
        params = jax.tree.map(lambda leaf, n=number: leaf[n], policies)
        env = make_environment(problem)
        exact = evaluate(env, playable(planner, params, {}, 0), episodes=1, seed=0).mean
        np.testing.assert_allclose(returns[number], exact, rtol=1e-5)


def test_policies_see_the_same_random_numbers(tmp_path):
    planner = make(load_problem(*tiny_files(tmp_path, spread=1.0)))
    returns = np.asarray(compile_exact_returns(planner, 4)(KEY, with_biases(planner, 0.1, 0.1)))
    np.testing.assert_array_equal(returns[0], returns[1])
    assert len(set(returns[0])) == 4


def test_policies_one_after_the_other_earn_the_same(tmp_path):
    planner = make(load_problem(*tiny_files(tmp_path, spread=1.0)))
    policies = with_biases(planner, 0.0, 0.1, 0.2)
    together = compile_exact_returns(planner, 2)(KEY, policies)
    in_turn = compile_exact_returns(planner, 2, side_by_side=2)(KEY, policies)
    np.testing.assert_allclose(in_turn, together, rtol=1e-5)


def test_what_the_policies_saw(tmp_path):
    planner = make(load_problem(*tiny_files(tmp_path)))
    # the unit is the box's width, 2
    states = compile_visits(planner, 1)(KEY, with_biases(planner, 0.1)).states
    np.testing.assert_allclose(states["x"][0, 0, :, 0], [0.2, 0.4, 0.6, 0.8], rtol=1e-6)
    # two positions, two actions of more than one feature
    assert step_bytes(planner) > 2 * 4 + 2 * 4


def test_the_end_and_the_discount_count(tmp_path):
    domain, instance = tmp_path / "d.rddl", tmp_path / "i.rddl"
    domain.write_text(CAR_DOMAIN)
    instance.write_text(CAR_INSTANCE)
    planner = make(load_problem(str(domain), str(instance)))
    # x is 0, 1 and then 2, where the episode ends
    returns = compile_exact_returns(planner, 1)(KEY, with_biases(planner, 1.0))
    assert float(returns[0, 0]) == pytest.approx(0.5)


def test_an_illegal_action_is_replaced_as_in_play(tmp_path):
    domain, instance = tmp_path / "d.rddl", tmp_path / "i.rddl"
    rule = "action-preconditions { push >= 0.0; push <= 1.0; x + push <= 1.0; };"
    text = CAR_DOMAIN.replace("action-preconditions { push >= 0.0; push <= 1.0; };", rule)
    domain.write_text(text)
    instance.write_text(CAR_INSTANCE.replace("0.5", "1.0"))
    problem = load_problem(str(domain), str(instance))
    planner = make(problem)
    # it moves once and then has to stay, at 1
    policies = with_biases(planner, 1.0)
    assert float(compile_exact_returns(planner, 1)(KEY, policies)[0, 0]) == pytest.approx(5.0)
    params = jax.tree.map(lambda leaf: leaf[0], policies)
    played = evaluate(make_environment(problem), playable(planner, params, {}, 0), 1, 0)
    assert played.mean == pytest.approx(5.0)
    assert played.illegal_actions == 0


PIT = {"RISK": "1.0", "REST": "0.0", "FALLEN": "false", "DISCOUNT": "1.0"}
REAL = {"KIND_OF_WATER": "real", "KIND_OF_BUY": "real", "KIND_OF_DRAW": "real"}


def returns_of_constants(problem, rollouts=1, **biases):
    """Returns [N] of a policy of constant raw actions."""
    planner = make(problem)
    params = with_biases(planner, 0.0)
    for name, own in params["own"].items():
        own["bias"] = jnp.full_like(own["bias"], biases.get(name, 0.0))
    return np.asarray(compile_exact_returns(planner, rollouts)(KEY, params))[0]


def test_a_rollout_that_comes_to_a_dead_end_is_lost():
    # one step, then three that nobody may play
    lost = returns_of_constants(toy("pit", **PIT), deep=5.0)
    np.testing.assert_allclose(lost, [lost_worth(3 / 4)])
    np.testing.assert_allclose(returns_of_constants(toy("pit", **PIT), flat=5.0), [8.0])
    # by the last step nothing has to be done any more
    once = problem_from(toy_text("pit", **PIT), 1)
    np.testing.assert_allclose(returns_of_constants(once, deep=5.0), [5.0])


def test_a_dead_end_by_chance_loses_as_many_rollouts_as_it_meets():
    returns = returns_of_constants(toy("pit", **PIT | {"RISK": "0.2"}), 2000, deep=5.0)
    is_whole = returns > LOST
    np.testing.assert_allclose(returns[is_whole], 20.0)
    assert np.mean(is_whole) == pytest.approx(0.8**3, abs=4 * np.sqrt(0.25 / 2000))


@pytest.mark.parametrize(
    ("bought", "returned"),
    [
        # one is drawn at each step, the third finds none
        (0.0, lost_worth(3 / 5)),
        # half of the box is one
        (0.5, 5 * (2.0 - 3.0)),
    ],
)
def test_an_empty_cistern_of_real_numbers_is_a_dead_end(bought, returned):
    found = returns_of_constants(toy("cistern", START="2.0", **REAL), buy=bought)
    np.testing.assert_allclose(found, [returned])


def test_what_is_legal_up_to_rounding_loses_nothing():
    # in 32 bit thirds do not add up to 1, and the state is no whole number of them
    text = toy_text("cistern", START="2.0", **REAL).replace(
        "draw <= water;", "buy / 3 + draw / 3 == 1 / 3; draw <= water + buy;"
    )
    np.testing.assert_allclose(returns_of_constants(problem_from(text)), [lost_worth(3 / 5)])


@pytest.mark.parametrize(
    ("rules", "may"),
    [
        ("forall_{?a : arm} [pull(?a) => ~pulled(?a)];", False),
        ("(sum_{?a : arm} [pull(?a)]) == 1;", False),
        ("(sum_{?a : arm} [pull(?a)]) <= 1; forall_{?a : arm} [pull(?a) => ~pulled(?a)];", False),
        ("(sum_{?a : arm} [pull(?a)]) == 1; forall_{?a : arm} [pull(?a) => ~pulled(?a)];", True),
        ("exists_{?a : arm} [~pulled(?a)];", True),
    ],
)
def test_which_rules_may_leave_no_action(rules, may):
    words = {"LIKELIHOOD": "1.0", "MOST": "pos-inf", "DISCOUNT": "1.0", "TERMINATION": "false"}
    assert may_leave_none(toy("lever", RULES=rules, **words).model) == may
