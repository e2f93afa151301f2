"""Neighbours through relations of tuples, and through two relations, worked out by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from mdpo_rddl.planner.plans.feature_values import feature_values
from mdpo_rddl.planner.plans.features import action_features
from mdpo_rddl.planner.plans.neighbours import distant_neighbours

# a grid of 1 x 3 places, of which the middle one is next to both others; and three cells of a
# road, 0 -> 1 -> 2, of which the last one leads to the only light
NEXT = np.zeros((1, 3, 1, 3), bool)
for one, other in ((0, 1), (1, 0), (1, 2), (2, 1)):
    NEXT[0, one, 0, other] = True
PARAMS = {
    "alive": ["x", "y"],
    "full": ["cell"],
    "set": ["x", "y"],
    "switch": ["light"],
    "NEXT": ["x", "y", "x", "y"],
    "FLOWS": ["cell", "cell"],
    "ENDS": ["cell", "light"],
    "LENGTH": ["cell", "cell"],
}
VALUES = {
    "set": np.zeros((1, 3)),
    "switch": np.zeros(1),
    "NEXT": NEXT,
    "FLOWS": np.array([[False, True, False], [False, False, True], [False, False, False]]),
    "ENDS": np.array([[False], [False], [True]]),
    "LENGTH": np.ones((3, 3)),
}
WORLD = SimpleNamespace(
    variable_params=PARAMS,
    variable_ranges=dict.fromkeys(PARAMS, "bool") | {"LENGTH": "real"},
    state_fluents=dict.fromkeys(["alive", "full"]),
    observ_fluents={},
    non_fluents=dict.fromkeys(["NEXT", "FLOWS", "ENDS", "LENGTH"]),
)


def features(action: str, distant: bool = True) -> dict[str, object]:
    found = action_features(WORLD, VALUES, action, distant).state
    return {
        feature.name: lambda value, feature=feature: np.asarray(
            feature_values([feature], {feature.fluent: value})[0]
        )
        for feature in found
    }


def test_the_places_of_a_grid_see_the_mean_of_their_neighbours():
    spread = features("set")["alive to NEXT"]
    np.testing.assert_array_equal(spread(np.array([[4.0, 6.0, 8.0]])), [[6.0, 6.0, 6.0]])
    np.testing.assert_array_equal(spread(np.array([[1.0, 0.0, 0.0]])), [[0.0, 0.5, 0.0]])
    # the other direction is the same
    assert "alive from NEXT" not in features("set")


def test_one_way_neighbours_of_tuples_count_in_both_directions(monkeypatch):
    one_way = np.zeros((1, 3, 1, 3), bool)
    one_way[0, 0, 0, 2] = True
    monkeypatch.setitem(VALUES, "NEXT", one_way)
    alive = np.array([[4.0, 6.0, 8.0]])
    np.testing.assert_array_equal(features("set")["alive to NEXT"](alive), [[8.0, 0.0, 0.0]])
    np.testing.assert_array_equal(features("set")["alive from NEXT"](alive), [[0.0, 0.0, 4.0]])


def test_a_light_sees_what_flows_into_what_leads_to_it():
    spread = features("switch")["full to FLOWS to ENDS"]
    np.testing.assert_array_equal(spread(np.array([2.0, 3.0, 5.0])), [3.0])
    # nothing comes behind the last cell
    assert "full from FLOWS to ENDS" not in features("switch")


def test_within_one_type_one_step_has_to_do():
    found = distant_neighbours(WORLD, VALUES, ["cell"], ["cell"])
    assert found == []


@pytest.mark.parametrize("action", ["set", "switch"])
def test_without_them_there_are_those_of_one_relation(action):
    near, all_of_them = features(action, distant=False), features(action)
    assert set(near) < set(all_of_them)
    assert not any(" NEXT" in name or name.count(" to ") > 1 for name in near)
