"""Additions to the policy's real actions: what is proposed, kept and shifted."""

import tracemalloc

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.tiny_policy import idle_policy

from mdpo_rddl.planner.climbing import Ascent
from mdpo_rddl.policy.lookahead.base import Climbed, Gain, Situation
from mdpo_rddl.policy.lookahead.components import Components
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.residuals import Residuals
from mdpo_rddl.policy.lookahead.simulator import Simulator
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment

BASE = np.array([0.5, -0.5], np.float32)


def begun(climb=lambda *_: None, **options):
    method = Residuals(depth=4, **options)
    assert method.applies(Components.of(idle_policy().planner))
    method.begin(Situation(BASE, 10, climb, 4))
    return method


def proposed(method, gains=(), seed=0):
    return method.propose(gains, np.random.default_rng(seed))


def test_units_are_the_widths_of_the_boxes():
    parts = Components.of(idle_policy().planner)
    np.testing.assert_array_equal(parts.units, [2.0, 2.0])
    np.testing.assert_array_equal(parts.is_real, [True, True])


def test_the_first_action_is_in_its_box_and_the_policy_is_kept_in_mind():
    candidates = proposed(begun())
    assert candidates.shape[1:] == (4, 2)
    assert np.all(np.abs(candidates[:, 0]) <= 1.0)
    # nothing is known yet: the first proposal is the policy itself
    np.testing.assert_array_equal(candidates[0], [BASE, [0, 0], [0, 0], [0, 0]])
    assert np.std(candidates[:, 1:]) > 0.01


def test_gradient_steps_are_proposed_and_shape_the_noise():
    end = np.full((4, 4, 2), 0.25, np.float32)
    sigma = np.array([[1.0, 0.0, 1.0, 0.0]] * 4)
    climbed = Climbed(Ascent.from_candidates(end), sigma)
    method = begun(lambda *_: climbed)
    candidates = proposed(method)
    np.testing.assert_array_equal(candidates[1:5], end)
    samples = candidates[5:]
    np.testing.assert_array_equal(samples[:, [1, 3]], 0.0)
    assert np.std(samples[:, 2]) > 0.01
    isotropic = begun(lambda *_: climbed, adaptive=False)
    assert np.all(np.std(proposed(isotropic)[5:, 1:], axis=0) > 0.01)


def test_later_rounds_search_nearer_the_best_of_all_rounds():
    method = begun()
    first = proposed(method)
    good = np.full((4, 2), 0.125, np.float32)
    gains = [Gain(good, 2.0, 0.1), Gain(first[7], -1.0, 0.1)]
    second = proposed(method, gains)
    np.testing.assert_allclose(second[0], good, atol=1e-6)
    third = proposed(method, [Gain(first[8], 1.0, 0.1)])
    np.testing.assert_allclose(third[1], good, atol=1e-6)
    spread = [np.abs(round_ - good).mean() for round_ in (first, second)]
    assert spread[1] < spread[0]


def test_the_plan_that_was_played_is_shifted_until_the_episode_ends():
    method = begun()
    chosen = np.arange(8, dtype=np.float32).reshape(4, 2) / 10.0
    method.shift(chosen)
    method.begin(Situation(BASE, 10, lambda *_: None))
    moved = np.vstack([chosen[1:], [[0.0, 0.0]]])
    expected = moved + np.eye(4, 1) * BASE
    np.testing.assert_allclose(proposed(method)[0], expected, atol=1e-6)
    method.reset()
    method.begin(Situation(BASE, 10, lambda *_: None))
    np.testing.assert_array_equal(proposed(method)[0], np.eye(4, 1) * BASE)


def test_an_episode_may_begin_with_a_plan():
    method, plan = begun(), np.zeros((6, 2), np.float32)
    plan[:, 0] = 0.1, 0.2, 0.3, 0.4, 0.5, 0.6
    method.resume(plan)
    expected = plan[:4] + np.eye(4, 1) * BASE
    method.begin(Situation(BASE, 10, lambda *_: None))
    np.testing.assert_allclose(proposed(method)[0], expected, atol=1e-6)
    # a longer candidate has what comes after its own steps
    whole = plan + np.eye(6, 1) * BASE
    method.shift(whole)
    expected = plan[1:5] + np.eye(4, 1) * BASE
    method.begin(Situation(BASE, 10, lambda *_: None))
    np.testing.assert_allclose(proposed(method)[0], expected, atol=1e-6)


def test_a_value_that_is_planned_is_chosen():
    method = Residuals(depth=2)
    parts = Components(
        parts={"push": slice(0, 1), "gear": slice(1, 2)},
        values=((), (-1.0, 0.0, 1.0)),
        is_real=np.array([True, False]),
        noop=np.zeros(2, np.float32),
        lower=np.array([-1.0, -np.inf]),
        upper=np.array([1.0, np.inf]),
        units=np.array([2.0, 0.0], np.float32),
        most=2,
    )
    assert method.applies(parts)
    base = np.array([0.25, 1.0], np.float32)
    changes = parts.changes(np.array([[2.0, 0.0], [0.25, 1.0]]), base)
    np.testing.assert_array_equal(changes, [[1.75, 2.0], [0.0, 0.0]])
    method.resume(changes)
    # the real is in its box, and where nothing is changed the policy chooses
    method.begin(Situation(base, 10, lambda *_: None))
    np.testing.assert_array_equal(proposed(method)[0], [[1.0, 0.0], [0.0, 0.0]])
    # the best samples so far have values of their own, not a mean of them
    gains = [
        Gain(np.array([row, [0, 0]], np.float32), gain, 0.1)
        for row, gain in (([0.0, -1.0], 2.0), ([0.5, 0.0], 1.0))
    ]
    np.testing.assert_array_equal(proposed(method, gains)[0, 0], [0.25, -1.0])


def test_of_many_components_as_many_candidates_as_memory_is_meant_for():
    count, steps = 4000, 40
    many = Components(
        parts={"push": slice(0, count)},
        values=((),) * count,
        is_real=np.ones(count, bool),
        noop=np.zeros(count, np.float32),
        lower=np.full(count, -1.0),
        upper=np.full(count, 1.0),
        units=np.ones(count, np.float32),
        most=count,
    )
    method = Residuals(depth=steps)
    assert method.applies(many)
    method.begin(Situation(np.zeros(count, np.float32), 1023, lambda *_: None))
    tracemalloc.start()
    candidates = proposed(method)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # one array of all 1023 in double precision would be 1.3 GB
    assert 50 < len(candidates) < 60
    assert np.std(candidates[1:]) > 0.01
    assert peak < 0.4e9


@pytest.mark.long
def test_a_policy_that_never_acts_is_improved():
    policy, clock = idle_policy(), Ticking(0.01)
    # another method looks further ahead
    simulator = Simulator(policy, 6, clock)
    method = Residuals(depth=4)
    assert method.applies(simulator.components)
    simulator.prepare({"x": np.zeros(2)}, 1.0)
    simulator.prepare_climbing({"x": np.zeros(2)})
    thinker = LookaheadPolicy(simulator, method, 1.0, seed=0, clock=clock)
    played = evaluate(make_environment(policy.problem), thinker, 1, 0)
    # the best is to pay for the start alone
    assert played.mean == pytest.approx(-0.5, abs=0.05)
    assert played.illegal_actions == 0
    assert policy.evaluate(episodes=1).mean == -2.0
