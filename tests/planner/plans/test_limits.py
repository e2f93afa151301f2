"""The largest values of each group."""

import numpy as np
import pytest

from mdpo_rddl.planner.plans.limits import are_largest

ROWS, COLUMNS = np.repeat(np.arange(3), 4), np.tile(np.arange(3), 4)
MIXED = np.array([2, 0, 0, 1, 2, 2, 1, 0, 1, 2, 0, 1])
FEWER = np.array([0, 0, 0, 1, -1, 2, 2, -1, 0, 2, 0, 2])


def expected(values, group, limits):
    """By a sort of each group, in which the first of equals comes first."""
    within = group < 0
    for number, limit in enumerate(limits):
        (members,) = np.nonzero(group == number)
        order = np.argsort(-values[members], kind="stable")
        within[members[order[:limit]]] = True
    return within


@pytest.mark.parametrize("group", [ROWS, COLUMNS, MIXED, FEWER, np.zeros(12, int)])
@pytest.mark.parametrize("most", [0, 1, 2, 9])
def test_the_largest_of_each_group_are_found(group, most):
    random = np.random.default_rng(most)
    for _ in range(20):
        limits = np.minimum(random.integers(0, most + 1, max(group) + 1), most)
        # with equal ones
        values = random.integers(0, 4, 12).astype(np.float32)
        found = are_largest(values, group, limits)
        np.testing.assert_array_equal(found, expected(values, group, limits))
