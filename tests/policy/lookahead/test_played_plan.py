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
    return PlayedPlan(depth=4, components=real)


def play(plan, *changes):
    """Single changes of the policy's action, one at each step."""
    for change in changes:
        plan.shift(rows(change + 0.5, 0, 0, 0), BASE)


def test_nothing_comes_after_the_steps_of_a_method_at_first(plan):
    assert plan.padded(np.ones((2, 3, 1))).tolist() == [[[1], [1], [1], [0]]] * 2
    assert plan.begin_again().tolist() == rows(0, 0, 0, 0).tolist()
    assert plan.followed(BASE) is None


def test_the_same_episode_begins_with_what_was_played_in_it(plan):
    play(plan, 1, 2, 3)
    assert plan.begin_again().tolist() == rows(1, 2, 3, 0).tolist()
    assert plan.followed(BASE).tolist() == rows(1.5, 2, 3, 0).tolist()
    assert plan.padded(rows(7, 8)[np.newaxis])[0].tolist() == rows(7, 8, 3, 0).tolist()


def test_a_plan_knows_its_step(plan):
    assert plan.step == 0
    play(plan, 1, 2)
    assert plan.step == 2
    plan.forget(7)
    assert plan.step == 7
    play(plan, 1)
    assert plan.step == 8
    # what came before is not known
    assert plan.begin_again().tolist() == rows(0, 0, 0, 0).tolist()
    assert plan.step == 0


def test_what_was_not_played_yet_is_still_planned(plan):
    play(plan, 1, 2, 3, 4)
    plan.begin_again()
    plan.shift(plan.followed(BASE) + np.eye(4, 1) * 4, BASE)
    assert plan.begin_again().tolist() == rows(5, 2, 3, 4).tolist()


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
    assert plan.begin_again().tolist() == rows(1, 0.25, 0, 0).tolist()


def test_an_episode_of_which_nothing_is_known_is_forgotten(plan):
    play(plan, 1, 2)
    plan.forget()
    assert not np.any(plan.begin_again())


def test_an_episode_may_be_longer_than_a_plan(plan):
    play(plan, *range(1, 7))
    assert plan.begin_again().tolist() == rows(1, 2, 3, 4).tolist()
