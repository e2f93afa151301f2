"""Programs of several arms: one after the other, and none that would come too late."""

import threading
import time

import pytest

from mdpo_rddl.auto.common.compilations import Compilations, TooLateError, compiled_within

LONG = 60.0


def end(work) -> bool:
    return work.wait(time.monotonic() + LONG)


def test_a_program_waits_for_the_one_before_it_even_if_that_fails():
    released, order = threading.Event(), []
    compilations = Compilations()

    def first():
        released.wait(LONG)
        order.append("first")
        raise ValueError("no gradient")

    one = compilations.add(first, LONG)
    two = compilations.add(lambda: order.append("second"), LONG)
    assert not two.wait(time.monotonic() + 0.1)
    assert order == []
    released.set()
    assert end(two)
    assert order == ["first", "second"]
    with pytest.raises(ValueError, match="no gradient"):
        end(one)


def test_a_program_that_would_come_too_late_is_not_begun():
    begun = []
    late = Compilations().add(lambda: begun.append("late"), -1.0)
    with pytest.raises(TooLateError):
        end(late)
    assert begun == []


def test_once_the_race_is_over_no_other_program_is_begun():
    released, begun = threading.Event(), []
    compilations = Compilations()
    one = compilations.add(lambda: bool(released.wait(LONG)), LONG)
    two = compilations.add(lambda: begun.append("second"), LONG)
    compilations.close()
    released.set()
    assert end(one)
    with pytest.raises(TooLateError):
        end(two)
    assert begun == []


def test_what_is_compiled_in_time_gives_its_result_or_its_error():
    def broken():
        raise ValueError("no model")

    assert compiled_within(LONG, lambda: 7) == 7
    with pytest.raises(ValueError, match="no model"):
        compiled_within(LONG, broken)


def test_a_call_that_compiles_too_long_is_left_alone():
    released, ended = threading.Event(), threading.Event()

    def slow():
        released.wait()
        ended.set()

    with pytest.raises(TooLateError, match="the time was over"):
        compiled_within(0.1, slow)
    assert not ended.is_set()
    released.set()
    assert ended.wait(LONG)


def test_without_time_no_call_is_begun():
    begun = []
    with pytest.raises(TooLateError):
        compiled_within(0.0, lambda: begun.append("late"))
    assert begun == []
