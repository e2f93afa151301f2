"""The feedback policy as a law: its likeliest proposal is played, what is forbidden is not."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.lakes import write_lake
from helpers.toys import toy

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.policy_gradient.actor import Actor, can_be_drawn

KEY = jax.random.PRNGKey(5)
LEVER = {"LIKELIHOOD": "0.75", "DISCOUNT": "1.0", "TERMINATION": "false"}
FREE = "forall_{?a : arm} [pull(?a) => true];"
RESTED = "forall_{?a : arm} [pull(?a) => ~pulled(?a)];"


@functools.cache
def planner_of(most: str = "2", rules: str = FREE) -> MDPOPlanner:
    problem = toy("lever", MOST=most, RULES=rules, **LEVER)
    return build_planner(problem, auto_preset("lever").without_section("Search")).planner


def params_with(planner: MDPOPlanner, bias: list[float]):
    params = planner.plan.initializer(KEY, {}, None)
    params["own"]["pull"] = {**params["own"]["pull"], "bias": jnp.array(bias)}
    return params


def state_with(pulled: list[bool]):
    return {"pulled": jnp.array(pulled)}


NOTHING = state_with([False, False, False])


def test_weights_are_the_policy_s_log_odds_and_the_likeliest_set_is_what_it_plays():
    planner = planner_of()
    actor, params = Actor(planner), params_with(planner, [0.1, 0.3, 0.2])
    weights = np.asarray(actor.weights(params, NOTHING, 0))
    np.testing.assert_allclose(weights, [0.4, 1.2, 0.8], rtol=1e-5)
    assert (actor.law.size, actor.law.most) == (3, 2)
    played = planner.legal_policy(KEY, params, {}, 0, NOTHING, {})
    sets = jnp.array([[False, True, True], [True, True, False], [False, True, False]])
    likely = jax.vmap(actor.law.log_probability, in_axes=(None, 0))(weights, sets)
    assert int(jnp.argmax(likely)) == 0
    np.testing.assert_array_equal(played["pull"], sets[0])


def test_the_limit_of_a_group_is_kept_without_any_other_rule():
    planner = planner_of("pos-inf", "(sum_{?a : arm} [pull(?a)]) <= 1;")
    actor, params = Actor(planner), params_with(planner, [1.0, 1.2, 0.9])
    assert not actor._legal.is_needed
    noise = actor.law.noise(KEY, (100,))
    played = jax.vmap(lambda one: actor.act(params, NOTHING, 0, one)["pull"])(noise)
    assert int(np.max(np.sum(played, axis=1))) == 1
    # one is proposed nearly always, and any of them
    assert np.all(np.sum(played, axis=0) > 0)


def test_the_order_is_kept_where_a_sigmoid_is_one():
    planner = planner_of("1")
    params = params_with(planner, [5.0, 6.0, 5.5])  # log-odds of 20, 24 and 22
    for policy in (planner.plan.test_policy, planner.legal_policy):
        played = policy(KEY, params, {}, 0, NOTHING, {})["pull"]
        np.testing.assert_array_equal(played, [False, True, False])


def test_what_an_implication_forbids_is_not_proposed():
    planner = planner_of("1", RESTED)
    actor, params = Actor(planner), params_with(planner, [2.0, 1.0, -1.0])
    noise = actor.law.noise(KEY, (200,))
    drawn = jax.vmap(lambda one, seen: actor.act(params, state_with(seen), 0, one), (0, None))
    free = np.asarray(drawn(noise, jnp.zeros(3, bool))["pull"])
    held = np.asarray(drawn(noise, jnp.array([True, False, False]))["pull"])
    assert np.mean(free[:, 0]) > 0.9
    assert not np.any(held[:, 0])
    # the chance goes to the others instead of to the no-op
    assert np.mean(held[:, 1]) > 0.9


def test_actions_are_the_law_s_draws_where_all_are_legal():
    planner = planner_of()
    actor, params = Actor(planner), params_with(planner, [0.0, 0.1, -0.1])
    noise = actor.law.noise(KEY, (50,))
    played = jax.vmap(lambda one: actor.act(params, NOTHING, 0, one)["pull"])(noise)
    weights = actor.weights(params, NOTHING, 0)
    drawn = jax.vmap(actor.law.draw, in_axes=(0, None))(noise, weights)
    np.testing.assert_array_equal(played, drawn)
    assert 0.2 < np.mean(drawn) < 0.7


def test_there_is_a_law_where_all_actions_are_bools(tmp_path):
    assert can_be_drawn(planner_of().rddl)
    assert not can_be_drawn(write_lake(tmp_path).model)


@pytest.mark.parametrize("most", ["1", "pos-inf"])
def test_the_limit_is_that_of_the_problem(most):
    assert Actor(planner_of(most)).law.most == (1 if most == "1" else 3)
