"""Where the environment raises an error in play, policies that avoid it are better."""

import dataclasses
import logging

import jax
import numpy as np
import pytest
from helpers.boiler import boiler
from helpers.lakes import preset
from helpers.toys import problem_from, toy

from mdpo_rddl.auto import plan_automatically
from mdpo_rddl.auto.probing.constants import with_bias
from mdpo_rddl.planner.config.fitting import without_scales
from mdpo_rddl.auto.probing.raising import watched
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.exact.exact import LOST, compile_exact_returns
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.problem.underlying import underlying_mdp


def always() -> bool:
    return True


@pytest.fixture(scope="module")
def kettle():
    return toy("kettle", TERMINATION="false")


def test_an_error_in_an_episode_of_the_no_op_is_seen_and_told(kettle, caplog):
    with caplog.at_level(logging.WARNING):
        assert watched(kettle, always).raises
    assert "Bernoulli" in caplog.text


def test_an_error_in_an_episode_of_random_actions_is_seen_and_told(caplog):
    with caplog.at_level(logging.WARNING):
        assert watched(toy("sail"), always).raises
    assert "for some actions" in caplog.text
    assert "Normal" in caplog.text


def test_an_episode_without_an_error_says_nothing(caplog):
    with caplog.at_level(logging.INFO):
        assert not watched(toy("kettle", TERMINATION="heat > 0.7"), always).raises
        assert not watched(toy("boats", TERMINATION="false"), always).raises
    assert not caplog.records


def test_the_episodes_end_when_their_time_is_over(kettle):
    assert not watched(kettle, iter([True, True, False, False]).__next__).raises
    assert not watched(toy("sail"), iter([True, False, False]).__next__).raises


def returns(problem) -> np.ndarray:
    """Of the no-op, and of a policy that always cools: one rollout of each [2]."""
    planner = build_planner(problem, without_scales(preset(1.0))).planner
    noop = planner.feedback_plan.noop(0)
    both = jax.tree.map(lambda *leaves: np.stack(leaves), noop, with_bias(noop, {"cool": 5.0}))
    return np.asarray(compile_exact_returns(planner, 1)(jax.random.PRNGKey(0), both))[:, 0]


def test_a_rollout_with_an_error_is_lost(kettle):
    noop, cooled = returns(watched(kettle, always))
    assert noop == np.float32(LOST)
    assert cooled == pytest.approx(-4.0)
    assert returns(kettle)[0] == pytest.approx(0.375 * 28)


def test_an_error_after_the_end_of_an_episode_counts_for_nothing(kettle):
    ending = toy("kettle", TERMINATION="heat > 0.7")
    noop, _ = returns(dataclasses.replace(ending, raises=True))
    assert noop == pytest.approx(0.375)


@pytest.mark.long
def test_the_race_avoids_it(kettle):
    policy = plan_automatically(kettle, preset(8.0), seed=0).policy
    played = evaluate(make_environment(kettle), policy, 4, 0)
    assert np.all(played.returns > 0.0)


def test_another_error_is_left_to_whoever_plays(kettle, monkeypatch):
    def step(env, action):
        raise ZeroDivisionError("a fault of its own")

    monkeypatch.setattr("pyRDDLGym.core.env.RDDLEnv.step", step)
    assert watched(kettle, always) is kettle


def test_no_arm_that_does_not_know_the_errors_takes_part(caplog):
    caplog.set_level(logging.WARNING)
    # whoever proves the optimum of its ground model lets the pressure rise
    problem = underlying_mdp(boiler())
    outcome = plan_automatically(problem, preset(5.0), 0)
    arms = {log.name for log in outcome.arms}
    assert "constants and rules" in arms
    assert not arms & {"dynamic programming", "trials", "relaxed plans", "greedy"}
    assert "policies must avoid it" in caplog.text
    env = make_environment(problem)
    evaluate(env, outcome.policy, episodes=3, seed=0)  # raises if one does


def test_what_an_illegal_no_op_would_raise_does_not_count(caplog):
    problem = problem_from(
        """domain d {
    pvariables {
        x : { state-fluent, bool, default = false };
        a : { action-fluent, bool, default = false };
    };
    cpfs { x' = if (a) then Bernoulli(0.5) else Bernoulli(2.0); };
    reward = x;
    action-preconditions { a; };
}
non-fluents n { domain = d; }
instance inst {
    domain = d; non-fluents = n; max-nondef-actions = pos-inf; horizon = 5; discount = 1.0;
}"""
    )
    with caplog.at_level(logging.INFO):
        assert not watched(problem, always).raises
    assert not caplog.records
