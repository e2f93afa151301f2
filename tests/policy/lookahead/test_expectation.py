"""What decisions add to what an episode is expected to gain."""

import numpy as np
import pytest

from mdpo_rddl.policy.lookahead.base import Gain
from mdpo_rddl.policy.lookahead.expectation import Expectation
from mdpo_rddl.policy.lookahead.gains import NOT_FINITE

PLAN, OTHER = np.ones((3, 1)), np.zeros((3, 1))


def gain(mean, candidate=PLAN, error=0.5, steps=1):
    return Gain(candidate, mean, error, steps)


def certain(discount=1.0):
    return Expectation(is_random=False, discount=discount)


def test_by_chance_a_decision_counts_for_what_is_gained_a_step():
    expectation = Expectation(is_random=True, discount=0.5)
    chosen = gain(6.0, steps=3)
    # the first step's reward is not discounted, the third one's is, by a quarter
    assert expectation.decided(0, chosen, None, left_base=True) == (2.0, 0.5 / 3)
    assert expectation.decided(2, chosen, chosen, left_base=True) == (0.5, 0.125 / 3)
    assert expectation.decided(2, chosen, None, left_base=False) == (0.0, 0.0)
    assert expectation.decided(2, None, chosen, left_base=False) == (0.0, 0.0)
    assert expectation.replaced(2) == 0.0


def test_a_plan_that_is_followed_counts_once():
    expectation = certain()
    assert expectation.decided(0, gain(10.0), None, left_base=True) == (10.0, 0.5)
    assert expectation.decided(1, gain(8.0), gain(8.0), left_base=True) == (0.0, 0.0)
    better = gain(9.0, candidate=OTHER)
    assert expectation.decided(2, better, gain(7.0), left_base=True) == (2.0, 0.5)
    # without time for a test it goes on
    assert expectation.decided(3, gain(0.0, error=0.0), None, left_base=True) == (0.0, 0.0)
    assert expectation.decided(4, gain(1.0), gain(1.0), left_base=True) == (0.0, 0.0)


def test_a_plan_counts_anew_in_each_episode():
    expectation = certain()
    expectation.decided(0, gain(10.0), None, left_base=True)
    expectation.decided(1, gain(11.0), gain(9.0), left_base=True)
    expectation.begin()
    assert expectation.decided(0, gain(12.5), gain(12.5), left_base=True) == (12.5, 0.5)
    # without time for a test as much as in the last episode, and once
    expectation.begin()
    for step, added in enumerate((12.5, 0.0, 0.0)):
        assert expectation.decided(step, gain(0.0), None, left_base=True) == (added, 0.0)
    # the policy alone may do badly by now
    assert expectation.decided(3, gain(90.0), gain(90.0), left_base=True) == (0.0, 0.0)
    expectation.forget()
    assert expectation.decided(0, gain(0.0), None, left_base=True) == (0.0, 0.0)


def test_what_is_replaced_is_not_expected_of_the_next_episode():
    expectation = certain()
    expectation.decided(0, gain(10.0), None, left_base=True)
    expectation.decided(1, gain(9.0), gain(9.0), left_base=True)
    assert expectation.replaced(1) == -9.0
    expectation.decided(2, gain(5.0), gain(5.0), left_base=True)
    expectation.begin()
    assert expectation.decided(0, gain(0.0), None, left_base=True) == (6.0, 0.0)


def test_what_is_left_of_a_plan_may_be_worth_less_than_nothing():
    expectation = certain()
    assert expectation.decided(0, gain(9.0), None, left_base=True) == (9.0, 0.5)
    assert expectation.decided(1, None, gain(-1.0), left_base=False) == (1.0, 0.0)
    # of what the policy played in the end nothing was counted
    assert expectation.decided(2, None, None, left_base=False) == (0.0, 0.0)


@pytest.mark.parametrize("mean", [NOT_FINITE, NOT_FINITE / 8, -np.inf])
def test_a_plan_without_a_finite_return_takes_nothing_back(mean):
    expectation = certain()
    expectation.decided(0, gain(9.0), None, left_base=True)
    assert expectation.decided(1, None, gain(mean), left_base=False) == (0.0, 0.0)


def test_what_is_not_played_is_taken_back_and_the_rest_counts_again():
    expectation = certain(discount=0.5)
    assert expectation.decided(0, gain(8.0), None, left_base=True) == (8.0, 0.5)
    expectation.decided(1, gain(16.0), gain(16.0), left_base=True)
    assert expectation.replaced(1) == -8.0
    assert expectation.decided(2, gain(12.0), gain(12.0), left_base=True) == (3.0, 0.125)


def test_a_plan_that_goes_on_untested_is_not_counted_again():
    expectation = certain()
    assert expectation.decided(0, gain(10.0), None, left_base=True) == (10.0, 0.5)
    expectation.decided(1, gain(0.0), None, left_base=True)
    assert expectation.replaced(1) == 0.0
    assert expectation.decided(2, gain(8.0), gain(8.0), left_base=True) == (0.0, 0.0)
