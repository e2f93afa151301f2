"""When a training makes smaller steps, by figures worked by hand."""

import pytest

from mdpo_rddl.auto.search.steps import has_stalled, step_factor


@pytest.mark.parametrize(
    ("iterations", "best", "stalled"),
    [
        (500, 0, False),
        (501, 0, True),
        # three tenths of 10,000
        (10_000, 7_000, False),
        (10_000, 6_999, True),
    ],
)
def test_a_phase_has_stalled_when_it_has_waited_long(iterations, best, stalled):
    assert has_stalled(iterations, best) == stalled


def test_steps_shrink_and_then_are_large_again():
    assert [step_factor(phase) for phase in range(7)] == pytest.approx(
        [1.0, 0.3, 0.09, 0.027, 0.0081, 1.0, 0.3]
    )
