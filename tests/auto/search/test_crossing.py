"""One plan of several, object by object."""

from types import SimpleNamespace

import numpy as np
import pytest

from mdpo_rddl.auto.search.crossing import crossed, parts_of

WIDE = SimpleNamespace(
    action_fluents=["turn", "push", "gear", "brake"],
    variable_params={"turn": ["ship"], "push": ["ship", "side"], "gear": ["car"], "brake": []},
    type_to_objects={"ship": ["a", "b"], "side": ["l", "r", "m"], "car": ["c"]},
)
PARTS = [(("turn", 0),), (("turn", 1),), (("turn", 2),)]
# of three objects at two steps, of three plans; 0 is best
PLANS = {"turn": np.array([[[0, 0, 5]] * 2, [[3, 0, 1]] * 2, [[2, 4, 0]] * 2], float)}


class Returns:
    """How near to zero everything is, less a penalty."""

    def __init__(self, penalty=lambda plan: 0.0):
        """Has evaluated nothing yet."""
        self.count, self._penalty = 0, penalty

    def __call__(self, plans):
        turns = plans["turn"]
        self.count += len(turns)
        return -np.abs(turns).sum(axis=(1, 2)) - np.array([self._penalty(plan) for plan in turns])


def test_parts_are_of_the_objects_that_come_first():
    assert parts_of(WIDE) == [
        (("turn", 0), ("push", 0)),
        (("turn", 1), ("push", 1)),
        (("gear", 0),),
        (("brake", None),),
    ]


def test_each_object_has_the_actions_that_return_most():
    evaluate = Returns()
    plan, reached = crossed(PLANS, evaluate(PLANS), PARTS, evaluate)
    np.testing.assert_array_equal(plan["turn"], np.zeros((2, 3)))
    assert reached == 0.0
    # the plans; each of three parts from two others; all together
    assert evaluate.count == 3 + 3 * 2 + 1


def test_where_objects_bear_on_each_other_one_is_exchanged():
    # more than one exchange costs more than it gains
    evaluate = Returns(lambda plan: 9.0 * (not plan.any()))
    plan, reached = crossed(PLANS, evaluate(PLANS), PARTS, evaluate)
    # the second plan leads, and loses most with its first object
    np.testing.assert_array_equal(plan["turn"], [[0, 0, 1]] * 2)
    assert reached == -2.0


def test_the_best_plan_stays_where_nothing_gains():
    evaluate = Returns(lambda plan: 99.0 * (len(np.unique(plan.sum(axis=1) % 2)) > 1))
    plans = {"turn": np.array([[[0, 0, 0]] * 2, [[1, 1, 1]] * 2], float)}
    plan, reached = crossed(plans, evaluate(plans), PARTS, evaluate)
    np.testing.assert_array_equal(plan["turn"], plans["turn"][0])
    assert reached == 0.0


@pytest.mark.parametrize(
    ("plans", "parts"), [(PLANS, PARTS[:1]), ({"turn": PLANS["turn"][:1]}, PARTS)]
)
def test_nothing_is_tried_with_one_object_or_one_plan(plans, parts):
    evaluate = Returns()
    returns = evaluate(plans)
    plan, reached = crossed(plans, returns, parts, evaluate)
    assert evaluate.count == len(returns)
    assert reached == max(returns)
    np.testing.assert_array_equal(plan["turn"], plans["turn"][np.argmax(returns)])


def test_of_many_objects_those_of_the_next_plans_are_tried():
    rows = np.zeros((4, 1, 300))
    rows[:, 0, :4] = [[0, 0, 0, 1], [1, 1, 0, 0], [1, 1, 1, 0], [1, 1, 1, 1]]
    evaluate = Returns()
    returns = evaluate({"turn": rows})
    parts = [(("turn", place),) for place in range(300)]
    plan, reached = crossed({"turn": rows}, returns, parts, evaluate)
    assert evaluate.count == 4 + 300 + 1
    assert reached == 0.0
    assert not plan["turn"].any()


def test_an_action_about_no_object_is_exchanged_as_a_whole():
    plans = {
        "turn": np.array([[[0.0]], [[2.0]]]),
        "brake": np.array([[2.0], [0.0]]),
    }
    parts = [(("turn", 0),), (("brake", None),)]

    def evaluate(plans):
        return -plans["turn"][:, 0, 0] - 0.5 * plans["brake"][:, 0]

    plan, reached = crossed(plans, evaluate(plans), parts, evaluate)
    assert (plan["turn"].item(), plan["brake"].item(), reached) == (0.0, 0.0, 0.0)
