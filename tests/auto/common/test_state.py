"""Flat states: what goes in comes out, and nothing else does."""

import numpy as np
import pytest

from mdpo_rddl.auto.common.state import State, count_of, generator_place, joined, set_generator


def test_parts_come_out_of_what_they_were_joined_to():
    one, other = State({"a": np.ones(2)}, {"n": 1}), State({"a": np.zeros(3)}, {"n": 2})
    both = joined(one.within("x"), other.within("x y"))
    assert sorted(both.tensors) == ["x y/a", "x/a"]
    assert both.bytes == 40
    np.testing.assert_array_equal(both.part("x").tensors["a"], np.ones(2))
    assert both.part("x y").values == {"n": 2}
    with pytest.raises(KeyError):
        both.part("y")


def test_an_array_has_the_shape_that_is_asked_for_and_is_a_copy():
    state = State({"a": np.ones((2, 3)), "s": np.array(["x"]), "nan": np.array([np.nan])})
    found = state.array("a", (None, 3))
    found[0] = 7.0
    assert state.tensors["a"][0, 0] == 1.0
    for name, shape in (("a", (2,)), ("a", (2, 4)), ("s", (1,)), ("nan", (1,))):
        with pytest.raises(ValueError, match=f"its {name} is"):
            state.array(name, shape)


@pytest.mark.parametrize("value", [-1, 1.5, "x", None, float("inf")])
def test_what_is_no_count_is_refused(value):
    assert count_of(3.0) == 3
    with pytest.raises((TypeError, ValueError, OverflowError)):
        count_of(value)


def test_a_generator_goes_on_where_another_was():
    one, other = np.random.default_rng(1), np.random.default_rng(2)
    one.random(5)
    set_generator(other, generator_place(one))
    assert one.random() == other.random()
