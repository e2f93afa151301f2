"""Numbers for states, against a dictionary."""

import numpy as np
import pytest

from mdpo_rddl.problem.enumeration.index import StateIndex


@pytest.mark.parametrize("words", [1, 3])
def test_a_state_keeps_the_number_that_it_was_given(words):
    index, expected = StateIndex(words), {}
    random = np.random.default_rng(words)
    for size in (3, 5000, 1, 9000, 300, 20_000):
        # few values, so that states come again, in one call and in later ones
        states = random.integers(0, 40_000 if words == 1 else 40, (size, words)).astype(np.uint64)
        unknown = [tuple(state) not in expected for state in states]
        known = index.known(states)
        np.testing.assert_array_equal(known < 0, unknown)
        numbers = index.numbers(states)
        new = {tuple(state): None for state in states if tuple(state) not in expected}
        found = dict(zip(map(tuple, states), numbers, strict=True))
        assert sorted(found[state] for state in new) == list(
            range(len(expected), len(expected) + len(new))
        )
        expected |= {state: found[state] for state in new}
        np.testing.assert_array_equal(numbers, [expected[tuple(state)] for state in states])
        assert index.count == len(expected)
    np.testing.assert_array_equal(index.numbers(index.states), np.arange(index.count))
