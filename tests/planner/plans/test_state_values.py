"""Values of states, worked by hand."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mdpo_rddl.planner.plans import state_values
from mdpo_rddl.planner.plans.state_values import StateValues, ValueShape

PARAMS = {
    "at": ["row", "column"],
    "wall": ["row", "column"],
    "dark": ["column"],
    "key": [],
    "speed": [],
    "other": ["door"],
    "facing": ["row"],
}
RANGES = dict.fromkeys(PARAMS, "bool") | {"speed": "real", "facing": "side"}
SIZES = {"row": 2, "column": 3, "door": 1}
SIDES = {"side": ["@left", "@right", "@up"]}
VALUES = {name: np.zeros([SIZES[kind] for kind in kinds]) for name, kinds in PARAMS.items()}
STATE = {
    "at": jnp.array([[0, 1, 0], [0, 0, 0]], bool),
    "wall": jnp.array([[1, 1, 0], [0, 0, 1]], bool),
    "dark": jnp.array([0, 1, 1], bool),
    "key": jnp.array(True),
    "speed": jnp.array(7.0),
    "other": jnp.array([True]),
    "facing": jnp.array([2, 0]),
}


def values_of(*names: str, **shape) -> StateValues:
    rddl = SimpleNamespace(
        state_fluents=names,
        variable_params=PARAMS,
        variable_ranges=RANGES,
        enum_types=set(SIDES),
        type_to_objects=SIDES,
    )
    return StateValues(rddl, VALUES, ValueShape(**shape), 4, jnp.float32)


def inputs_of(*names: str, **shape) -> list[float]:
    return np.asarray(values_of(*names, **shape).inputs(STATE)).tolist()


def test_fluents_of_the_same_objects_are_multiplied():
    own = [0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 1]
    assert inputs_of("at", "wall") == [*own, 0, 1, 0, 0, 0, 0]


def test_a_fluent_of_some_of_the_objects_meets_that_of_all():
    assert inputs_of("at", "dark") == [0, 1, 0, 0, 0, 0, 0, 1, 1, 0, 1, 0, 0, 0, 0]
    assert inputs_of("key", "dark") == [1, 0, 1, 1, 0, 1, 1]


def test_those_of_different_objects_are_not_multiplied():
    assert inputs_of("dark", "other") == [0, 1, 1, 1]


def test_numbers_are_read_in_their_units_and_cut_off():
    assert inputs_of("speed", state_scales={"speed": [1.0, 4.0]}) == [1.5]
    assert inputs_of("speed") == [5.0]


def test_of_an_object_it_is_read_which_it_is():
    values = values_of("key", "facing", state_scales={"facing": [1.0, 0.5]})
    inputs = np.asarray(values.inputs(STATE)).tolist()
    # the key, the places in the order, which object each is, and what is there with the key
    assert inputs == [1, 2, -2, *(0, 0, 1), *(1, 0, 0), 2, -2]
    assert values.size == len(inputs)


def test_products_that_are_too_many_are_left_out(monkeypatch):
    monkeypatch.setattr(state_values, "_MOST_INPUTS", 17)
    assert values_of("at", "wall").size == 12
    assert values_of("at", "dark").size == 15


def weights_of(values: StateValues) -> dict:
    """Of two units, one of which is off."""
    ones = jnp.ones(values.size)
    return {
        "direct": 2.0 * ones,
        "direct_left": 4.0 * ones,
        "hidden": jnp.stack([ones, -ones], axis=1),
        "bias": jnp.array([3.0, 0.0]),
        "bias_left": jnp.array([2.0, 0.0]),
        "output": jnp.array([10.0, 99.0]),
        "output_left": jnp.array([100.0, 99.0]),
    }


def test_the_value_is_a_line_and_a_hidden_layer_that_know_what_is_left():
    values = values_of("dark", units=2)
    weights, inputs = weights_of(values), values.inputs(STATE)
    # two inputs are on, and half of the horizon is left
    line, unit = 2.0 * (2.0 + 0.5 * 4.0), 2.0 + 3.0 + 0.5 * 2.0
    expected = line + unit * (10.0 + 0.5 * 100.0)
    assert float(values.value(weights, inputs, 2)) == pytest.approx(expected)
    tripled = values.rescaled(weights, 3.0)
    assert float(values.value(tripled, inputs, 2)) == pytest.approx(3.0 * expected)
    for step in (4, 5):
        assert float(values.value(weights, inputs, step)) == 0.0


def test_at_first_every_value_is_zero():
    values = values_of("at", "dark")
    weights = values.initial(jax.random.PRNGKey(0))
    assert float(values.value(weights, values.inputs(STATE), 0)) == 0.0
    assert np.std(weights["hidden"]) == pytest.approx(np.sqrt(4.0 / values.size), rel=0.1)


@pytest.mark.parametrize("units", [0, -1, 1.5, True, 10**6, "8"])
def test_units_must_be_a_number_of_them(units):
    with pytest.raises(ValueError, match="units: must be a whole number from 1"):
        ValueShape(units=units)


def test_few_changes_have_the_value_of_all_that_is_read():
    values = values_of("at", "wall")
    weights = {
        name: jax.random.normal(jax.random.PRNGKey(number), leaf.shape)
        for number, (name, leaf) in enumerate(values.initial(jax.random.PRNGKey(0)).items())
    }
    inputs = values.inputs(STATE)
    places = np.array([[1, 4], [0, 0], [7, 0]])
    changes = jnp.array([[-1.0, 0.5], [1.0, 2.0], [0.25, 0.0]])
    for step in (1, 4):
        found = values.changed(weights, inputs, places, changes, step)
        for one, place, change in zip(found, places, changes, strict=True):
            other = values.value(weights, inputs.at[place].add(change), step)
            np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-5)
