"""Work beside the race: what it sends, how it ends, and what it may take."""

import math
import os
import time

import numpy as np
import pytest

from mdpo_rddl.race import beside
from mdpo_rddl.race.beside import Beside, EndedError

MEMORY = 2**28


@pytest.fixture(params=["process", "thread"])
def begun(request, monkeypatch):
    """Begins work and ends it with the test."""
    if request.param == "thread":
        monkeypatch.setattr(beside, "_forked", lambda *given: None)
    all_begun = []

    def begin(work, clock=time.monotonic):
        all_begun.append(Beside(work, clock, MEMORY))
        return all_begun[-1]

    yield begin
    for each in all_begun:
        each.close()


def test_results_come_in_order_and_then_the_end(begun):
    def work(send, clock):
        send({"clock": clock()})
        send(np.arange(3))

    working = begun(work, lambda: 7.0)
    assert working.receive() == {"clock": 7.0}
    np.testing.assert_array_equal(working.receive(), [0, 1, 2])
    with pytest.raises(EndedError, match=r"^$"):
        working.receive()
    with pytest.raises(EndedError):
        working.receive()


def test_news_are_told_before_they_are_received(begun):
    working = begun(lambda send, clock: send(1))
    while not working.has_news():
        time.sleep(0.001)
    assert working.receive() == 1


def test_a_failure_is_told_in_one_line(begun):
    def work(send, clock):
        raise ValueError("first\nsecond")

    with pytest.raises(EndedError, match=r"^first second$"):
        begun(work).receive()


def test_without_news_nothing_is_waited_for(begun):
    def work(send, clock):
        while clock() < math.inf:
            time.sleep(0.001)

    assert not begun(work).has_news()


def test_a_process_is_ended_whatever_it_does():
    def work(send, clock):
        send(os.getpid())
        while True:
            pass

    working = Beside(work, time.monotonic, MEMORY)
    number = working.receive()
    os.kill(number, 0)
    working.close()
    with pytest.raises(ProcessLookupError):
        os.kill(number, 0)


def test_a_thread_is_told_that_nobody_wants_its_results(monkeypatch):
    monkeypatch.setattr(beside, "_forked", lambda *given: None)
    told = []

    def work(send, clock):
        send(None)
        while clock() < math.inf:
            time.sleep(0.001)
        told.append(True)

    working = Beside(work, time.monotonic, MEMORY)
    working.receive()
    working.close()
    while not told:
        time.sleep(0.001)


def test_a_process_that_takes_too_much_memory_fails_alone():
    def work(send, clock):
        send(len(np.zeros(MEMORY // 16)))
        send(len(np.zeros(MEMORY // 4)))

    working = Beside(work, time.monotonic, MEMORY)
    assert working.receive() == MEMORY // 16
    with pytest.raises(EndedError, match="allocate"):
        working.receive()
    working.close()


def test_a_process_that_is_killed_has_ended():
    def work(send, clock):
        os.kill(os.getpid(), 9)

    working = Beside(work, time.monotonic, MEMORY)
    with pytest.raises(EndedError, match="was ended"):
        working.receive()
    working.close()
