"""Programs that know how long they take."""

import pytest

from mdpo_rddl.auto.common.compilations import TooLateError
from mdpo_rddl.auto.common.timing import Timed, made_once


class Watch:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_the_first_call_compiles():
    watch = Watch()

    def work(seconds: float) -> str:
        watch.now += seconds
        return f"{seconds:g} s"

    timed = Timed(work, watch)
    assert (timed.calls, timed.compile_seconds) == (0, 0.0)
    assert timed(5.0) == "5 s"
    assert (timed.seconds, timed.compile_seconds) == (5.0, 5.0)
    timed(1.0)
    timed(seconds=2.0)
    assert (timed.calls, timed.seconds, timed.compile_seconds) == (3, 2.0, 3.0)
    timed(6.0)  # a busy machine is no negative compilation
    assert timed.compile_seconds == 0.0


def test_the_deadline_is_the_first_calls_alone():
    watch, played = Watch(), []
    late, early = (Timed(lambda: played.append(1), watch, deadline) for deadline in (0.0, 60.0))
    with pytest.raises(TooLateError):
        late()
    assert (late.calls, played) == (0, [])
    early()
    watch.now = 100.0
    early()
    assert (early.calls, played) == (2, [1, 1])


def test_a_function_is_made_where_it_is_called_first_and_once():
    made = []

    def make():
        made.append("made")
        return lambda one, other: one - other

    difference = made_once(make)
    assert made == []
    assert (difference(5, 3), difference(5, other=1)) == (2, 4)
    assert made == ["made"]
