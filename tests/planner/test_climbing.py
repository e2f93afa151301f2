"""Gradient steps on an action and on additions to the policy's actions after it."""

import jax
import numpy as np
import pytest
from helpers.tiny_policy import idle_policy

from mdpo_rddl.noise import AdaptiveNoise
from mdpo_rddl.planner.climbing import Ascent, Climbing, ClimbSize

START = {"x": np.zeros(2)}
NOISE = AdaptiveNoise(sigma_min=0.25, sigma_max=1.0)


@pytest.fixture(scope="module")
def climb():
    policy = idle_policy()
    program = Climbing(policy.planner).compile(ClimbSize(2, 1, 6), np.full(2, 2.0), NOISE)
    arguments = policy.params, policy.policy_hyperparams

    def call(start, candidates, rates, steps):
        place = START, start
        key = jax.random.PRNGKey(0)
        candidates = np.asarray(candidates, np.float32)
        rates = np.broadcast_to(np.reshape(rates, (2, -1)), candidates.shape[:2])
        ascent = Ascent.from_candidates(candidates)
        for count in np.atleast_1d(steps):
            ascent, sigma = program(key, arguments, place, ascent, rates, int(count))
        return np.asarray(ascent.candidates), np.asarray(sigma)

    return call


def test_each_candidate_climbs_at_its_own_rate(climb):
    zero = np.zeros((2, 3, 2))
    reached, _ = climb(0, zero, [0.01, 0.0], 200)
    # the goal is half a unit away: the first action goes there, and the others stay
    np.testing.assert_allclose(np.cumsum(reached[0], axis=0), np.full((3, 2), 0.5), atol=0.02)
    np.testing.assert_array_equal(reached[1], zero[1])
    # Adam's first step has the rate's length, in units of the component
    np.testing.assert_allclose(climb(0, zero, [0.01, 0.0], 1)[0][0], np.full((3, 2), 0.02), 1e-5)


def test_a_step_without_a_rate_stays(climb):
    rates = np.array([[0.01, 0.0, 0.01], [0.0, 0.01, 0.0]])
    moved = np.any(climb(0, np.zeros((2, 3, 2)), rates, 3)[0] != 0.0, axis=2)
    np.testing.assert_array_equal(moved, rates > 0.0)


def test_an_ascent_goes_on_where_it_was_left(climb):
    zero = np.zeros((2, 3, 2))
    whole, halves = (climb(0, zero, [0.01, 0.03], steps)[0] for steps in (8, (4, 4)))
    np.testing.assert_allclose(halves, whole, atol=1e-6)


def test_the_first_action_stays_in_its_box(climb):
    outside = np.full((2, 3, 2), 5.0)
    assert np.max(climb(0, outside, [0.0, 0.0], 1)[0][:, 0]) == 1.0


def test_what_the_box_cuts_off_comes_back(climb):
    beyond = np.zeros((2, 3, 2))
    beyond[:, 1] = 1.5
    reached, _ = climb(0, beyond, [0.05, 0.0], 20)
    assert np.all(reached[0, 1] < 1.0)


@pytest.mark.parametrize("start", [0, 2])
def test_sigma_is_large_where_the_return_answers(climb, start):
    _, sigma = climb(start, np.zeros((2, 5, 2)), [0.0, 0.0], 1)
    left = 4 - start
    # an action at step t moves the left - 1 - t states that are still paid for
    assert sigma[0, 0] == pytest.approx(1.0, abs=0.1)
    assert np.all(np.diff(sigma[0, :left]) < 0.0)
    # the last action comes too late, and nothing is played beyond the horizon
    np.testing.assert_allclose(sigma[0, left - 1 :], 0.25)
