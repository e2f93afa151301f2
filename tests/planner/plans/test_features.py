"""What an action's objects see of the state: the right fluents, at the right objects."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.problems import shipped

from mdpo_rddl.planner.plans.feature_values import feature_values
from mdpo_rddl.planner.plans.features import Feature, action_features, observed_fluents

# two rooms, three doors; a door joins rooms, a room has doors
PARAMS = {
    "open": ["door", "room"],
    "locked": ["door"],
    "warm": ["room"],
    "wind": [],
    "heard": ["room", "door"],
    "LEADS": ["door", "room"],
    "SIZE": ["room"],
    "SAME": ["room"],
    "YEAR": [],
}
VALUES = {
    "open": np.zeros((3, 2)),
    "LEADS": np.array([[True, True], [False, True], [False, False]]),
    "SIZE": np.array([1.0, 3.0]),
    "SAME": np.array([2.0, 2.0]),
    "YEAR": np.array(2023.0),
}
HOUSE = SimpleNamespace(
    variable_params=PARAMS,
    variable_ranges=dict.fromkeys(PARAMS, "real") | {"LEADS": "bool"},
    state_fluents=dict.fromkeys(["locked", "warm", "wind", "heard"]),
    observ_fluents={},
    non_fluents=dict.fromkeys(["LEADS", "SIZE", "SAME", "YEAR"]),
)


def seen(feature: Feature, value: np.ndarray) -> np.ndarray:
    (one,) = feature_values([feature], {feature.fluent: value})
    return np.asarray(one)


def spread(name: str, value: object) -> np.ndarray:
    features = action_features(HOUSE, VALUES, "open").state
    feature = next(feature for feature in features if feature.name == name)
    return np.broadcast_to(seen(feature, np.asarray(value, float)), (3, 2))


def test_a_fluent_counts_at_the_actions_own_objects():
    np.testing.assert_array_equal(spread("locked", [1, 2, 3]), [[1, 1], [2, 2], [3, 3]])
    np.testing.assert_array_equal(spread("warm", [4, 5]), [[4, 5]] * 3)
    np.testing.assert_array_equal(spread("wind", 7), np.full((3, 2), 7.0))


def test_axes_in_another_order_are_laid_along_the_actions():
    value = np.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(spread("heard", value), value.T)


def test_a_relation_gives_the_neighbours_mean_in_both_directions():
    # door 0 leads to both rooms, door 1 to room 1, door 2 to none
    np.testing.assert_array_equal(spread("warm from LEADS", [4, 6])[:, 0], [5, 6, 0])
    np.testing.assert_array_equal(spread("locked to LEADS", [1, 3, 9])[0], [1, 2])


def test_objects_that_the_action_does_not_know_are_averaged():
    features = action_features(HOUSE, {**VALUES, "calm": np.zeros(())}, "open")
    assert "warm" in [feature.name for feature in features.state]
    house = SimpleNamespace(**vars(HOUSE) | {"variable_params": {**PARAMS, "calm": []}})
    calm = action_features(house, {**VALUES, "calm": np.zeros(())}, "calm").state
    means = {f.name: float(seen(f, np.array([1.0, 3.0]))) for f in calm if f.name == "warm"}
    assert means == {"warm": 2.0}


def test_constants_differ_between_objects_and_are_standardised():
    constants = action_features(HOUSE, VALUES, "open").constant
    assert set(constants) == {"SIZE", "LEADS"}
    np.testing.assert_allclose(constants["SIZE"], [[-1, 1]] * 3)


def test_two_axes_of_one_type_are_two_axes():
    params = {**PARAMS, "move": ["room", "room"], "near": ["room", "room"]}
    house = SimpleNamespace(
        **vars(HOUSE) | {"variable_params": params, "state_fluents": {"near": None}}
    )
    features = action_features(house, {**VALUES, "move": np.zeros((2, 2))}, "move").state
    value = np.array([[1.0, 2.0], [3.0, 4.0]])
    np.testing.assert_array_equal(seen(features[0], value), value)


def test_a_fluent_of_one_object_is_seen_at_both_ends_of_an_action():
    params = {**PARAMS, "move": ["room", "room"]}
    house = SimpleNamespace(
        **vars(HOUSE) | {"variable_params": params, "state_fluents": {"warm": None}}
    )
    features = action_features(house, {**VALUES, "move": np.zeros((2, 2))}, "move").state
    spreads = {
        feature.name: np.broadcast_to(seen(feature, np.array([1.0, 2.0])), (2, 2))
        for feature in features
    }
    np.testing.assert_array_equal(spreads["warm at argument 1"], [[1, 1], [2, 2]])
    np.testing.assert_array_equal(spreads["warm at argument 2"], [[1, 2], [1, 2]])


def test_a_partially_observed_problem_shows_its_observations_only():
    assert observed_fluents(HOUSE) == ["locked", "warm", "wind", "heard"]
    hidden = SimpleNamespace(**vars(HOUSE) | {"observ_fluents": {"warm": None}})
    assert observed_fluents(hidden) == ["warm"]


@pytest.mark.parametrize(
    ("instance", "action", "names"),
    [
        ("reservoir15", "release", ["rlevel", "rlevel from RES_CONNECT", "rlevel to RES_CONNECT"]),
        ("powergen7", "curProd", ["temperature", "prevProd", "prevOn"]),
        ("hvac10", "heat-input", ["temp-zone", "temp-zone from ADJ-HEATER", "temp-heater"]),
    ],
)
def test_the_shipped_problems_have_the_features_that_a_rule_needs(instance, action, names):
    model = shipped(instance, 2).model
    sizes = {kind: len(objects) for kind, objects in model.type_to_objects.items()}
    values = {
        name: np.reshape(value, [sizes[kind] for kind in model.variable_params[name]])
        for name, value in {**model.non_fluents, **model.action_fluents}.items()
    }
    features = action_features(model, values, action)
    assert set(names) <= {feature.name for feature in features.state}
