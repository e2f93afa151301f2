"""Whether others delay what is compiled: arms that gain nothing, and searches before it."""

from types import SimpleNamespace

import pytest
from helpers.clocks import Stopped
from helpers.races import raced

from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.race import rounds
from mdpo_rddl.auto.race.schedule import Schedule
from mdpo_rddl.planner.config.search_section import Search


class Stalled(Arm):
    """Uses its slices up and finds nothing."""

    def _work(self, until):
        self._clock.now = until


class Compiling(Stalled):
    """Is compiled in 50 seconds, half as fast while others work."""

    waited = 0.0

    def is_worth_waiting(self, seconds):
        return True

    @property
    def is_pending(self):
        return self._clock.now + self.waited < 100.0

    def await_program(self, until):
        self.waited += until - self._clock.now
        self._clock.now = until


@pytest.mark.parametrize(
    ("cores", "expected"),
    [
        (1, (5.0, 52.5)),  # one slice of 5 s, and 47.5 s without it
        (2, (100.0, 100.0)),  # two slices of 5 s and nine of 10 s
    ],
)
def test_who_gains_nothing_waits_once_it_has_had_a_slice(monkeypatch, cores, expected):
    monkeypatch.setattr(rounds, "usable_cores", lambda: cores)
    clock, judge = Stopped(), SimpleNamespace(best_mean=0.0, incumbent=object())
    arena = SimpleNamespace(judge=judge, clock=clock, began=0.0, deadline=160.0, seconds=160.0)
    schedule = Schedule(arena, Search(), lambda name: None)
    monkeypatch.setattr(schedule, "_judge_candidates", lambda arm: False)
    compiling, stalled = Compiling("gradient", clock), Stalled("shared weights", clock)
    schedule._contend(compiling, lambda: None)
    schedule._contend(stalled, lambda: 0.0)
    begun = []

    def work(until):
        begun.append((stalled.log.seconds, clock.now))
        clock.now = 160.0

    monkeypatch.setattr(compiling, "work", work)
    schedule._compete(160.0, polishing=False)
    assert begun == [expected]


def test_the_gradient_begins_before_searches_that_would_leave_it_no_time(
    lake, in_one_arena, caplog
):
    arms = list(raced(lake, 300.0, own_until=0.84).diagnostics()["arms"])
    assert arms.index("gradient") < arms.index("shared weights")
    assert "too little time for the gradient" not in caplog.text
