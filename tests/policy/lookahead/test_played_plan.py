"""The plan of a whole episode, of which a method changes the next steps."""

import numpy as np
import pytest

from mdpo_rddl.policy.lookahead.components import Components
from mdpo_rddl.policy.lookahead.played_plan import PlayedPlan

BASE = np.array([0.5], np.float32)


def rows(*values):
    return np.array(values, np.float32)[:, np.newaxis]


@pytest.fixture
def plan():
    real = Components(
        parts={"push": slice(0, 1)},
        values=((),),
        is_real=np.array([True]),
        noop=np.zeros(1, np.float32),
        lower=np.array([-9.0]),
        upper=np.array([9.0]),
        units=np.ones(1, np.float32),
        most=1,
    )
    return PlayedPlan(depth=4, horizon=4, components=real)


def begun_again(plan):
    plan.go_to(0)
    return plan.rest


def play(plan, *changes):
    """Single changes of the policy's action, one at each step."""
    for change in changes:
        plan.shift(rows(change + 0.5, 0, 0, 0), BASE)


def test_nothing_comes_after_the_steps_of_a_method_at_first(plan):
    assert plan.padded(np.ones((2, 3, 1))).tolist() == [[[1], [1], [1], [0]]] * 2
    assert begun_again(plan).tolist() == rows(0, 0, 0, 0).tolist()
    assert plan.followed(BASE) is None


def test_the_same_episode_begins_with_what_was_played_in_it(plan):
    play(plan, 1, 2, 3)
    assert begun_again(plan).tolist() == rows(1, 2, 3, 0).tolist()
    assert plan.followed(BASE).tolist() == rows(1.5, 2, 3, 0).tolist()
    assert plan.padded(rows(7, 8)[np.newaxis])[0].tolist() == rows(7, 8, 3, 0).tolist()


def test_a_plan_knows_its_step(plan):
    play(plan, 1, 2)
    assert plan.step == 2
    # asked again, or later than expected
    plan.go_to(1)
    assert plan.rest.tolist() == rows(2, 0, 0, 0).tolist()
    plan.go_to(3)
    play(plan, 4)
    assert begun_again(plan).tolist() == rows(1, 2, 0, 4).tolist()
    # beyond the horizon nothing counts
    plan.go_to(9)
    assert plan.rest.tolist() == rows(0, 0, 0, 0).tolist()
    play(plan, 5)
    assert begun_again(plan).tolist() == rows(1, 2, 0, 4).tolist()


def test_what_was_not_played_yet_is_still_planned(plan):
    play(plan, 1, 2, 3, 4)
    plan.go_to(0)
    plan.shift(plan.followed(BASE) + np.eye(4, 1) * 4, BASE)
    assert begun_again(plan).tolist() == rows(5, 2, 3, 4).tolist()


def test_a_plan_moves_on_with_the_step_that_is_played(plan):
    plan.shift(rows(9, 2, 3, 4), BASE)
    assert plan.padded(rows(7)[np.newaxis])[0].tolist() == rows(7, 3, 4, 0).tolist()
    assert plan.followed(BASE).tolist() == rows(2.5, 3, 4, 0).tolist()
    # where the policy is played the plan is left
    play(plan, 0)
    assert plan.followed(BASE) is None


def test_what_was_played_in_its_place_counts(plan):
    play(plan, 1, 2)
    plan.replace(np.array([0.75], np.float32), BASE)
    assert begun_again(plan).tolist() == rows(1, 0.25, 0, 0).tolist()


def test_an_episode_of_which_nothing_is_known_is_forgotten(plan):
    play(plan, 1, 2)
    plan.forget()
    assert not np.any(begun_again(plan))


def test_an_episode_may_be_longer_than_a_plan(plan):
    longer = PlayedPlan(depth=2, horizon=4, components=plan.components)
    for change in range(1, 5):
        longer.shift(rows(change + 0.5, 9), BASE)
    assert begun_again(longer).tolist() == rows(1, 2).tolist()
    longer.go_to(2)
    assert longer.rest.tolist() == rows(3, 4).tolist()
