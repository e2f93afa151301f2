"""What the methods propose, and how an action's components are laid side by side."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from helpers.levers import NONE, lever_policy

from mdpo_rddl.policy.lookahead.base import Gain, Situation
from mdpo_rddl.policy.lookahead.components import Components
from mdpo_rddl.policy.lookahead.coordinate import Coordinate
from mdpo_rddl.policy.lookahead.first_actions import FirstActions

RANDOM = np.random.default_rng(0)


def components(**words):
    return Components.of(lever_policy(**words).planner)


def situation(base):
    return Situation(base, 10, lambda *_: None)


def proposed(method, gains=()):
    return sorted(tuple(map(int, candidate[0])) for candidate in method.propose(gains, RANDOM))


def test_components_there_and_back():
    three = components()
    action = {"pull": np.array([True, False, True])}
    np.testing.assert_array_equal(three.flat(action), [1.0, 0.0, 1.0])
    back = three.action(np.array([0.0, 1.0, 1.0]), action)["pull"]
    assert back.dtype == bool
    np.testing.assert_array_equal(back, [False, True, True])


@pytest.mark.parametrize(("most", "count"), [("1", 4), ("2", 7), ("3", 8), ("pos-inf", 8)])
def test_how_many_joint_actions_there_are(most, count):
    three = components(MOST=most)
    assert three.joint_actions == count
    method = FirstActions()
    assert method.applies(three)
    method.begin(situation(np.zeros(3)))
    # all but the policy's own
    assert len(proposed(method)) == len(set(proposed(method))) == count - 1
    assert proposed(method, [Gain(np.zeros((1, 3)), 1.0, 0.1)]) == []


def test_coordinate_changes_go_on_from_what_gained():
    method = Coordinate()
    assert method.applies(components())
    method.begin(situation(np.array(NONE, float)))
    assert proposed(method) == [(0, 0, 1), (0, 1, 0), (1, 0, 0)]
    gains = [
        Gain(np.array([[0.0, 0.0, 1.0]]), 3.0, 0.0),
        Gain(np.array([[1.0, 0.0, 0.0]]), 1.0, 0.0),
        Gain(np.array([[0.0, 1.0, 0.0]]), -2.0, 0.0),
    ]
    # the changes that gained together come first
    np.testing.assert_array_equal(method.propose(gains, RANDOM)[0, 0], [1, 0, 1])
    assert (0, 1, 1) in proposed(method, gains)
    # an exchange of the third for another
    assert (1, 0, 0) in proposed(method, gains)
    assert proposed(method, gains[2:]) == []


def bools(count, most):
    return Components(
        parts={"pull": slice(0, count)},
        values=((0.0, 1.0),) * count,
        is_real=np.zeros(count, bool),
        noop=np.zeros(count),
        lower=np.full(count, -np.inf),
        upper=np.full(count, np.inf),
        units=np.zeros(count),
        most=most,
    )


@pytest.mark.parametrize(
    ("count", "most", "expected"),
    [
        (20_000, 20_000, np.inf),
        (20_000, 1, 20_001),
        (20_000, 2, np.inf),
        (300, 2, 1 + 300 + 300 * 299 / 2),
        (16, 16, 2**16),
    ],
)
def test_joint_actions_are_counted_until_they_are_many(count, most, expected):
    assert bools(count, most).joint_actions == expected


def test_what_has_one_value_makes_no_joint_action_more():
    three = replace(bools(3, 3), values=((0.0, 1.0), (2.0,), (0.0, 1.0)))
    assert three.joint_actions == 4
    unlisted = replace(bools(3, 3), values=((0.0, 1.0), (), (0.0, 1.0)))
    assert unlisted.joint_actions == np.inf


def test_of_many_components_only_what_is_proposed_is_built():
    count = 2000
    many = bools(count, count)
    method = Coordinate()
    method.applies(many)
    base = np.arange(count) % 2.0
    method.begin(situation(base))
    tracemalloc.start()
    # of its own: how many are proposed would depend on the tests before
    candidates = method.propose((), np.random.default_rng(1))[:, 0]
    _, most_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # two million exchanges, each with an entry for each component, would have thousands of times
    # as many
    assert most_bytes < 20 * candidates.nbytes
    assert 300 < len(candidates) <= 600
    changed = np.sum(candidates[1:] != base, axis=1)
    assert {1, 2} <= set(changed.tolist())


def test_whole_numbers_of_many_values_are_changed_by_powers_of_two():
    parts = Components(
        parts={"order": slice(0, 2), "open": slice(2, 3)},
        values=((), (), (0.0, 1.0)),
        is_real=np.zeros(3, bool),
        noop=np.zeros(3),
        lower=np.array([-0.5, -np.inf, -np.inf]),
        upper=np.array([20.0, np.inf, np.inf]),
        units=np.zeros(3),
        most=1,
    )
    assert parts.near(0, 5.0) == [0.0, 1.0, 3.0, 4.0, 6.0, 7.0, 9.0, 13.0, 20.0]
    assert {-507.0, 4.0, 517.0} < set(parts.near(1, 5.0))
    assert parts.near(2, 1.0) == (0.0, 1.0)
    assert parts.joint_actions == np.inf
    method = Coordinate()
    assert method.applies(parts)
    method.begin(situation(np.array([5.0, 0.0, 0.0])))
    candidates = set(proposed(method))
    assert {(0, 0, 0), (20, 0, 0), (4, 0, 0), (5, 1, 0), (5, 0, 1)} <= candidates
    # five of the one exchanged for four of the other
    assert (0, 4, 0) in candidates
    assert all(0 <= first <= 20 for first, _, _ in candidates)
    assert (5, 0, 0) not in candidates
