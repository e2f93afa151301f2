"""What an environment shows, as numbers."""

import numpy as np
import pytest

from mdpo_rddl.problem.load import load_problem, make_environment
from mdpo_rddl.problem.observation import as_numbers, is_observed


@pytest.mark.parametrize("value", [None, np.array([None, None])])
def test_nothing_is_observed_before_the_first_step(value):
    assert not is_observed(value)
    assert is_observed(np.zeros(2))


def test_an_object_is_the_place_of_its_name():
    model = make_environment(load_problem("fleet4")).model
    names = np.array(model.type_to_objects["place"])
    np.testing.assert_array_equal(as_numbers(model, "at", names), range(len(names)))
    np.testing.assert_array_equal(as_numbers(model, "at", [2, 0]), [2, 0])
    assert as_numbers(model, "waiting", [True, False]).dtype == bool
