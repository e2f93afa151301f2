"""Changes that are tried together for what each affects."""

import numpy as np

from mdpo_rddl.planner.plans.effects import Effects

AFFECTS = np.array(
    [
        [1, 1, 0, 0, 0],
        [0, 1, 1, 0, 0],
        [0, 0, 0, 1, 0],
        [0, 0, 0, 0, 0],
    ],
    bool,
)


def test_no_number_is_affected_by_two_changes_of_a_set():
    effects = Effects.of(AFFECTS)
    assert len(effects.together) == 2
    for chosen in effects.together:
        assert AFFECTS[chosen].sum(axis=0).max() <= 1
    np.testing.assert_array_equal(effects.together.sum(axis=0), 1)
    assert all(effects.together[s, change] for change, s in enumerate(effects.of_change))


def test_the_places_are_those_that_are_affected():
    effects = Effects.of(AFFECTS)
    for change, own in enumerate(AFFECTS):
        places = effects.places[change][effects.mask[change]]
        np.testing.assert_array_equal(np.sort(places), np.flatnonzero(own))


def test_changes_that_affect_all_are_tried_alone():
    effects = Effects.of(np.ones((3, 4), bool))
    np.testing.assert_array_equal(effects.together, np.eye(3, dtype=bool))
