"""Where a race is: which parts are over, and when the others end."""

import pytest
from helpers.clocks import Stopped

from mdpo_rddl.auto.resuming.marks import Marks


class Race:
    """Began a minute ago."""

    began, deadline = 100.0, 400.0

    def __init__(self, seconds: float) -> None:
        self.clock = Stopped(self.began + seconds)


def test_each_part_of_a_race_that_begins_has_its_turn():
    marks = Marks()
    assert list(marks.once("rules", Race(5.0), 120.0)) == [120.0]
    # also one whose time is over already
    assert list(marks.once("plan", Race(50.0), 120.0)) == [120.0]
    assert marks.decided("improves", lambda: True) is True
    assert marks.values() == {
        "ends": {"plan": 20.0, "rules": 20.0},
        "begun": ["plan", "rules"],
        "over": ["plan", "rules"],
        "decided": {"improves": True},
    }


def test_a_part_in_which_a_race_was_stopped_ends_when_it_would_have_ended():
    marks = Marks()
    for _ in marks.once("rules", Race(0.0), 110.0):
        pass
    turn = marks.once("plan", Race(12.0), 130.0)
    assert next(turn) == 130.0  # and it never ends
    marks.end("rounds", Race(12.0), 190.0)
    marks.decide("has plan", False)
    again, race = Marks(marks.values()), Race(20.0)
    race.began, race.deadline = 1000.0, 1300.0  # by the clock of another process
    race.clock.now = 1020.0
    assert list(again.once("rules", race, 1099.0)) == []
    assert list(again.once("plan", race, 1099.0)) == [1030.0]
    assert again.end("rounds", race, 1099.0) == 1090.0
    assert again.decided("has plan", lambda: True) is False


def test_a_part_whose_time_has_passed_is_left_out_unless_it_had_begun():
    marks = Marks({"ends": {"plan": 30.0}})
    assert list(marks.once("plan", Race(31.0), 199.0)) == []
    assert marks.is_over("plan")
    # what it has found must be handed in
    marks = Marks({"ends": {"plan": 30.0}, "begun": ["plan"]})
    assert list(marks.once("plan", Race(31.0), 199.0)) == [130.0]


@pytest.mark.parametrize(
    "values",
    [
        {"ends": {"a": "x"}},
        {"ends": {"a": float("nan")}},
        {"ends": 3},
        {"decided": {"a": "x"}},
        {"decided": {"a": 1.0}},
        {"decided": {"slices": float("inf")}},
        {"decided": {"slices": 1.5}},
        {"decided": {"slices": -1}},
        {"decided": {"random": float("nan")}},
        {"decided": {"random": "x"}},
    ],
)
def test_what_are_no_marks_is_refused(values):
    with pytest.raises((AttributeError, TypeError, ValueError)):
        Marks(values)


def test_no_part_ends_after_the_deadline():
    marks = Marks({"ends": {"rounds": 1e12}})
    assert marks.end("rounds", Race(5.0), 200.0) == 400.0
    assert list(marks.once("rounds", Race(5.0), 200.0)) == [400.0]
    assert marks.end("plan", Race(5.0), 500.0) == 400.0


def test_a_return_that_is_not_finite_is_asked_for_anew():
    marks = Marks()
    assert marks.decided("random", lambda: -float("inf")) == -float("inf")
    assert marks.decided("slices", lambda: 3) == 3
    again = Marks(marks.values())
    assert again.decided("random", lambda: -2.0) == -2.0
    assert again.decided("slices", lambda: 9) == 3
