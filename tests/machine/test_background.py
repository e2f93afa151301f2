"""Work in a thread of its own: what it raises, and what becomes of it after the deadline."""

import threading
import time

import pytest

from mdpo_rddl.machine.background import Background


def test_work_that_ends_in_time():
    done = []
    work = Background(lambda: done.append("done"))
    assert work.wait(time.monotonic() + 60.0)
    assert work.has_ended
    assert done == ["done"]


def test_what_it_raises_is_raised_each_time_that_it_is_waited_for():
    def broken():
        raise KeyError("cause")

    work = Background(broken)
    for _ in range(2):
        with pytest.raises(KeyError, match="cause"):
            work.wait(time.monotonic() + 60.0)


def test_work_that_takes_too_long_goes_on_while_nobody_waits():
    released = threading.Event()
    work, started = Background(lambda: bool(released.wait())), time.monotonic()
    assert not work.wait(started + 0.2)
    assert not work.wait(started)
    assert not work.has_ended
    released.set()
    assert work.wait(time.monotonic() + 60.0)


def test_the_process_waits_for_work_that_a_daemon_has_started():
    # XLA aborts a process that ends Python beside one of its own calls
    is_daemon = []

    def start():
        Background(lambda: is_daemon.append(threading.current_thread().daemon)).join()

    caller = threading.Thread(target=start, daemon=True)
    caller.start()
    caller.join()
    assert is_daemon == [False]


def test_an_interrupt_leaves_the_work_alone(monkeypatch):
    released = threading.Event()
    work = Background(lambda: bool(released.wait(60.0)))

    def interrupted(seconds):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(work._done, "wait", interrupted)
        with pytest.raises(KeyboardInterrupt):
            work.wait(time.monotonic() + 60.0)
    assert not work.has_ended
    released.set()
    assert work.wait(time.monotonic() + 60.0)
