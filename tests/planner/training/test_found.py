"""What is kept of the iterations of a long training."""

import numpy as np
import pytest

from mdpo_rddl.planner.training.found import Found


class Status:
    """Of an iteration that is not the last one."""

    name = "NORMAL"

    def is_terminal(self):
        return False


def found_after(callbacks: int, each: int) -> Found:
    """After calls of so many iterations each."""
    found = Found(in_calls=True)
    for number in range(callbacks):
        iteration = (number + 1) * each - 1
        returns = np.array([float(number)])
        found.add(
            {
                "iteration": iteration,
                "train_return": returns,
                "test_return": returns,
                "sigma": np.zeros((1, 3)),
                "sensitivity": np.zeros((1, 3)),
                "status": Status(),
                "best_return": float(number),
                "last_iteration_improved": iteration,
                "best_index": 0,
                "best_params": None,
                "params": {"w": np.zeros(1)},
            }
        )
    return found


@pytest.mark.parametrize("each", [1, 5, 10, 50])
def test_records_are_spread_over_all_calls(each):
    found = found_after(1500, each)
    iterations = [entry["iteration"] for entry in found.kept]
    assert 300 < len(iterations) <= 602
    assert iterations[0] == each - 1
    assert iterations[-1] == 1500 * each - 1
    gaps = np.diff(iterations)
    assert max(gaps) <= 4 * each
    assert len({*gaps[:-1]}) == 1
