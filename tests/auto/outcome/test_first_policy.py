"""The no-op, before anything is compiled."""

import pytest
from helpers.lakes import preset
from helpers.toys import toy

from mdpo_rddl.auto.outcome.first_policy import first_policy


class Asked:
    """Says to go on so many times."""

    def __init__(self, times: int) -> None:
        self.times, self.count = times, 0

    def __call__(self) -> bool:
        self.count += 1
        return self.count <= self.times


@pytest.fixture(scope="module")
def problem():
    return toy("quest")


def test_an_episode_that_takes_too_long_is_given_up(problem):
    go_on = Asked(2)
    assert first_policy(problem, preset(1.0), 0, go_on) is None
    assert go_on.count == 3


def test_one_episode_in_time_is_enough(problem):
    steps = problem.horizon
    go_on = Asked(steps)
    found = first_policy(problem, preset(1.0), 0, go_on)
    assert found is not None
    assert found.label == "no-op"
    # before each of its steps, and after it
    assert go_on.count == steps + 1
