"""Features that are computed together have the values that each of them has alone."""

import numpy as np
import pytest

from mdpo_rddl.planner.plans.feature_values import feature_values, weighted_sum
from mdpo_rddl.planner.plans.features import Feature, action_features, observed_fluents
from mdpo_rddl.problem.load import load_problem

# a network of machines, a grid with relations of tuples, and cells that lead to lights
TASKS = ["SysAdmin_MDP_ippc2011", "Wildfire_MDP_ippc2014", "Traffic_MDP_ippc2014"]


def found(task: str) -> tuple[dict[str, np.ndarray], dict[str, tuple[Feature, ...]]]:
    """Random values of the state, and the features of each action fluent."""
    model = load_problem(task, "1").model
    sizes = {name: len(objects) for name, objects in model.type_to_objects.items()}
    shapes = {
        name: tuple(sizes[kind] for kind in kinds) for name, kinds in model.variable_params.items()
    }
    given = {**model.non_fluents, **model.state_fluents, **model.action_fluents}
    values = {name: np.reshape(value, shapes[name]) for name, value in given.items()}
    random = np.random.default_rng(0)
    state = {
        name: random.standard_normal(shapes[name]).astype(np.float32)
        for name in observed_fluents(model)
    }
    features = {
        name: action_features(model, values, name, distant=True).state
        for name in model.action_fluents
    }
    return state, features


@pytest.mark.parametrize("task", TASKS)
def test_together_as_alone(task):
    state, features = found(task)
    together = 0
    for each in features.values():
        values = feature_values(each, state)
        together += sum(feature.means is not None for feature in each)
        for feature, value in zip(each, values, strict=True):
            (alone,) = feature_values([feature], state)
            assert np.shape(value) == np.shape(alone)
            np.testing.assert_allclose(value, alone, atol=1e-6)
    assert together > 1


def test_fluents_of_the_same_type_share_their_neighbours():
    _, features = found("Wildfire_MDP_ippc2014")
    for each in features.values():
        means = {id(feature.means) for feature in each if feature.means is not None}
        assert 0 < len(means) < sum(feature.means is not None for feature in each)


def test_a_weighted_sum_has_the_shape_of_all():
    values = [np.ones((1, 1)), np.array([[1.0, 2.0]]), np.array([[1.0], [3.0], [5.0]])]
    values += [np.array([[10.0, 20.0]])]
    total = weighted_sum(np.array([1.0, 2.0, 3.0, 0.5]), values)
    # 1 + 2 (1, 2) + 0.5 (10, 20) along the columns, 3 (1, 3, 5) along the rows
    np.testing.assert_allclose(total, [[11.0, 18.0], [17.0, 24.0], [23.0, 30.0]])
