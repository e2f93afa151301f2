"""The plan of a whole episode, of which a method changes the next steps."""

import numpy as np
import pytest

from mdpo_rddl.policy.lookahead.played_plan import PlayedPlan


def rows(*values):
    return np.array(values, np.float32)[:, np.newaxis]


@pytest.fixture
def plan():
    return PlayedPlan(depth=4, size=1)


def play(plan, *changes):
    """Single changes of the policy's action, one at each step."""
    for change in changes:
        plan.shift(rows(9, 0, 0, 0), rows(change)[0])


def test_nothing_comes_after_the_steps_of_a_method_at_first(plan):
    assert plan.padded(np.ones((2, 3, 1))).tolist() == [[[1], [1], [1], [0]]] * 2
    assert plan.begin_again().tolist() == rows(0, 0, 0, 0).tolist()


def test_the_same_episode_begins_with_what_was_played_in_it(plan):
    play(plan, 1, 2, 3)
    assert plan.begin_again().tolist() == rows(1, 2, 3, 0).tolist()
    assert plan.padded(rows(7, 8)[np.newaxis])[0].tolist() == rows(7, 8, 3, 0).tolist()
    # then the episode is what is played now
    play(plan, 5)
    assert plan.begin_again().tolist() == rows(5, 0, 0, 0).tolist()


def test_a_plan_moves_on_with_the_step_that_is_played(plan):
    plan.shift(rows(9, 2, 3, 4), rows(1)[0])
    assert plan.padded(rows(7)[np.newaxis])[0].tolist() == rows(7, 3, 4, 0).tolist()
    # where the policy is played the plan is left
    plan.shift(rows(9, 0, 0, 0), rows(0)[0])
    assert plan.padded(rows(7)[np.newaxis])[0].tolist() == rows(7, 0, 0, 0).tolist()


def test_an_episode_of_which_nothing_is_known_is_forgotten(plan):
    play(plan, 1, 2)
    plan.forget()
    assert not np.any(plan.begin_again())


def test_an_episode_may_be_longer_than_a_plan(plan):
    play(plan, *range(1, 7))
    assert plan.begin_again().tolist() == rows(1, 2, 3, 4).tolist()
