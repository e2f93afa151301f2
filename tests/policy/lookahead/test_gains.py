"""Gains and their errors: rounding is no gain, and equal gains are no certainty."""

import numpy as np
import pytest

from mdpo_rddl.policy.lookahead.gains import NOT_FINITE, Scores, paired_gains

STEPS = 40


def summed(rewards):
    """Returns as a rollout adds them up in single precision."""
    total = np.zeros(rewards.shape[1:], np.float32)
    for reward in rewards.astype(np.float32):
        total = total + reward
    return total


@pytest.mark.parametrize("size", [1e-7, 1.0, 1e6])
def test_rounding_is_no_gain_whatever_the_size_of_the_returns(size):
    rewards = size * (1.0 + np.random.default_rng(0).random((STEPS, 1000)))
    # the same rewards in another order
    returns = np.stack([summed(rewards), summed(rewards[::-1])])
    assert np.any(returns[0] != returns[1])
    assert not paired_gains(returns, STEPS).any()
    better = np.stack([summed(rewards), summed(rewards) * np.float32(1.00001)])
    np.testing.assert_allclose(paired_gains(better, STEPS), 1e-5 * better[:1], rtol=0.05)


def test_what_will_be_played_bounds_what_rounding_makes_of_it():
    # rounding lets the base miss 1 in the second scenario, and the third one's candidate
    returns = np.array([[1.0, 0.0, 1.0], [0.75, 0.75, 0.75], [1.5, 1.5, 0.5]], np.float32)
    assert paired_gains(returns, 1).tolist() == [[-0.25, 0.75, -0.25], [0.5, 1.5, -0.5]]
    certain = paired_gains(returns, 1, is_certain=True)
    assert certain.tolist() == [[-0.25, -0.25, -0.25], [0.5, 0.5, -0.5]]


def test_a_return_that_is_not_finite_is_no_gain():
    returns = np.array([[1.0, -np.inf, np.inf], [np.nan, 2.0, np.inf], [3.0, 0.0, 0.0]], np.float32)
    lost = NOT_FINITE
    assert paired_gains(returns, 1).tolist() == [[lost, lost, lost], [2.0, lost, lost]]


def played(*gains):
    scores = Scores.of(len(gains))
    for number, each in enumerate(gains):
        scores.add(np.array([number]), np.array([each]))
    return scores


def test_errors_are_those_of_the_means():
    gains = np.random.default_rng(0).normal(size=(2, 50))
    scores = played(*gains)
    np.testing.assert_allclose(scores.mean, gains.mean(axis=1))
    np.testing.assert_allclose(scores.error, gains.std(axis=1, ddof=1) / np.sqrt(50))
    assert played([1.0]).error.tolist() == [np.inf]


def test_equal_gains_are_as_uncertain_as_one_more_could_make_them():
    equal, others = [2.0] * 9, [-3.0, 4.0] * 5
    scores = played(equal, others)
    # the error of nine gains that are equal and one that is off by seven
    one_more = np.array([2.0] * 9 + [2.0 - 7.0])
    assert scores.error[0] == pytest.approx(one_more.std(ddof=1) / np.sqrt(10))
    # where nothing differs nothing is known of how much it could
    assert played(equal, [0.0] * 9).error.tolist() == [0.0, 0.0]
    # a return that is not finite is no measure
    assert played(equal, [NOT_FINITE, 0.0]).error[0] == 0.0
