"""When an enumeration is given up, by figures worked by hand."""

import pytest
from helpers.clocks import Stopped
from helpers.toys import toy

from mdpo_rddl.problem.enumeration import model
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import ground_model
from mdpo_rddl.problem.enumeration.pace import Pace, expected
from mdpo_rddl.problem.enumeration.rules import OpenRules


def after(seconds: float) -> Pace:
    """The pace of an enumeration with 20 s, so many of which are over."""
    clock = Stopped()
    pace = Pace(EnumerationLimits(seconds=20.0, clock=clock))
    clock.now = seconds
    return pace


def test_it_ends_once_what_waits_takes_longer_than_the_time_left():
    # 100 states a second, for 15 s more
    after(5.0).check(500, 1500)
    with pytest.raises(NotEnumerableError, match="1,501 states more would take 15 s, and 15 s"):
        after(5.0).check(500, 1501)


def test_at_first_the_pace_is_not_known():
    after(0.9).check(1, 10**6)
    after(5.0).check(0, 10**6)
    with pytest.raises(NotEnumerableError):
        after(1.1).check(1, 10**6)


@pytest.mark.parametrize(
    ("latest", "before", "depths", "count"),
    [
        (120, 100, 9, 120 + 144 + 172.8),
        (120, 100, 1, 120 + 144),
        (120, 100, 0, 120),
        # no growth faster than by half is believed to last
        (100, 1, 9, 100 + 150 + 225),
        (90, 100, 9, 90),
    ],
)
def test_growth_is_expected_to_last_for_two_depths(latest, before, depths, count):
    assert expected(latest, before, depths) == pytest.approx(count)


def test_laws_of_joint_actions_are_given_up_by_their_pace(monkeypatch):
    clock, closed = Stopped(), OpenRules.closed

    def slow(self, *arguments):
        clock.now += 30.0
        return closed(self, *arguments)

    monkeypatch.setattr(OpenRules, "closed", slow)
    problem = toy("quest")
    assert len(ground_model(problem, EnumerationLimits(seconds=1e3, clock=clock)).actions) == 5
    clock.now = 0.0
    # the first ones say little
    assert ground_model(problem, EnumerationLimits(seconds=150.0, clock=clock)).actions
    monkeypatch.setattr(model, "_FEWEST_LAWS", 2)
    clock.now = 0.0
    with pytest.raises(NotEnumerableError, match=r"3 joint actions' laws more .* 90 s, and 40 s"):
        ground_model(problem, EnumerationLimits(seconds=100.0, clock=clock))
