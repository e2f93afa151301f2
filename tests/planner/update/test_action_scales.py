"""How large an action without a box must be."""

import numpy as np
import pytest

from mdpo_rddl.planner.update.action_scales import answering_size

SIZES = np.array([0.0, 1.0, 10.0, 100.0, -1.0, -10.0, -100.0])


@pytest.mark.parametrize(
    ("returns", "size"),
    [
        # the best where one gains
        ([-50.0, -49.0, -20.0, -70.0, -60.0, -60.0, -60.0], 10.0),
        ([-50.0, -60.0, -60.0, -60.0, -50.0, -30.0, -40.0], 10.0),
        # else the largest that costs little
        ([-50.0, -50.1, -51.0, -90.0, -50.1, -70.0, -90.0], 10.0),
        # of those to which the return answers
        ([-50.0, -50.1, -50.2, -50.0, -50.0, -50.0, -50.0], 10.0),
        # where it answers to none, none is too large
        ([-50.0] * 7, 1.0),
        # all do harm, or diverge
        ([-50.0, *[-90.0] * 6], 1e-3),
        ([-50.0, *[-np.inf] * 6], 1e-3),
    ],
)
def test_the_size_by_the_returns_of_constants(returns, size):
    assert answering_size(SIZES, np.array(returns)) == pytest.approx(size)


def test_a_gain_beside_other_actions_counts():
    alone = [-50.0, -50.0, -50.0, -50.0, -50.0, -50.0, -50.0]
    beside = [-60.0, -55.0, -30.0, -5.0, -60.0, -60.0, -60.0]
    assert answering_size(SIZES, np.array([alone, beside])) == 100.0
