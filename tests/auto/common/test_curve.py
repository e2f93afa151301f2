"""What a race's curve says of more time."""

import pytest

from mdpo_rddl.auto.common.curve import late_gain


def curve(*points):
    """Incumbents at so many seconds, and a candidate that was none."""
    best = [
        {"seconds": when, "mean_return": mean, "became_incumbent": True} for when, mean in points
    ]
    return [*best, {"seconds": 59.0, "mean_return": 1e6, "became_incumbent": False}]


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        # from -100 to -20, of which the last 20 after half of the time
        ([(5.0, -100.0), (20.0, -40.0), (40.0, -20.0)], 0.25),
        # all of it early, or late
        ([(5.0, -60.0), (30.0, -20.0)], 0.0),
        ([(31.0, -20.0)], 1.0),
        # what is below the floor at half of the time has gained nothing yet
        ([(5.0, -300.0), (40.0, -50.0)], 1.0),
        # nothing is gained
        ([(5.0, -100.0)], None),
        ([(5.0, -300.0)], None),
        ([], None),
        ([(5.0, None), (40.0, -50.0)], None),
    ],
)
def test_the_last_half_has_its_share_of_what_was_gained_over_the_floor(points, expected):
    assert late_gain(curve(*points), 60.0, -100.0) == expected
    assert late_gain(curve(*points), 60.0, None) is None


def test_a_best_policy_that_returns_less_later_has_gained_nothing_late():
    assert late_gain(curve((5.0, -20.0), (40.0, -21.0)), 60.0, -100.0) == 0.0
