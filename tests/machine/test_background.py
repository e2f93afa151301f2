"""Work in a thread of its own: what it raises, and what becomes of it after the deadline."""

import threading
import time

import pytest

from mdpo_rddl.errors import Cancelled
from mdpo_rddl.machine import background
from mdpo_rddl.machine.background import run_until


def test_work_that_ends_in_time():
    done = []
    assert run_until(lambda work: done.append(work.is_abandoned), time.monotonic() + 60.0)
    assert done == [False]


def test_what_it_raises_is_raised():
    def broken(work):
        raise KeyError("cause")

    with pytest.raises(KeyError, match="cause"):
        run_until(broken, time.monotonic() + 60.0)


def test_work_that_takes_too_long_is_abandoned_and_ends_when_it_asks():
    deaf, told = threading.Event(), threading.Event()

    def slow(work):
        deaf.wait(60.0)
        try:
            work.raise_if_cancelled()
        except Cancelled:
            if work.is_abandoned:
                told.set()
            raise

    started = time.monotonic()
    assert not run_until(slow, started + 0.3)
    assert time.monotonic() - started < 30.0
    deaf.set()
    assert told.wait(60.0)


def test_an_interrupt_lets_the_work_finish_what_it_has(monkeypatch):
    begun, finished = threading.Event(), threading.Event()

    def task(work):
        begun.set()
        try:
            while True:
                work.raise_if_cancelled()
                time.sleep(0.01)
        except Cancelled:
            finished.set()

    wait, calls = background._wait, []

    def interrupted(thread, until):
        calls.append(until)
        if len(calls) == 1:
            begun.wait(60.0)
            raise KeyboardInterrupt
        wait(thread, until)

    monkeypatch.setattr(background, "_wait", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_until(task, time.monotonic() + 60.0)
    assert finished.is_set()
