"""The line to a child: messages that are cut, garbled, late, endless or come bit by bit."""

import socket
import threading

import pytest

from mdpo_rddl.machine import messages
from mdpo_rddl.machine.messages import Correspondence, GarbledError, Messages


@pytest.fixture
def ends():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        yield Correspondence(ours), theirs


def test_messages_go_both_ways(ends):
    parent, theirs = ends
    child = Messages(theirs)
    for message in ({"a": [1.5, None, "ü\n"]}, [], "x" * 10_000):
        parent.send(message)
        assert child.receive() == message
        child.send(message)
        child.send(1)
        assert parent.receive(1.0) == message
        assert parent.receive(1.0) == 1
    parent.close()
    with pytest.raises(EOFError):
        child.receive()


def test_a_message_that_is_cut_is_waited_for_and_no_longer(ends):
    parent, theirs = ends
    theirs.sendall(b'{"a": [1, ')
    with pytest.raises(TimeoutError):
        parent.receive(0.2)
    with pytest.raises(TimeoutError):
        parent.receive(0.0)
    theirs.sendall(b'2]}\n"next"\n{"half')
    assert parent.receive(1.0) == {"a": [1, 2]}
    assert parent.receive(0.0) == "next"
    theirs.close()
    with pytest.raises(EOFError):
        parent.receive(60.0)


@pytest.mark.parametrize("text", [b"\n", b"}{\n", b"\xff\xfe\n", b"[" * 100_000 + b"\n"])
def test_what_is_garbled_is_no_message(ends, text):
    parent, theirs = ends
    theirs.sendall(text)
    with pytest.raises(GarbledError):
        parent.receive(1.0)


def test_what_does_not_end_is_no_message(ends, monkeypatch):
    parent, theirs = ends
    monkeypatch.setattr(messages, "MOST_BYTES", 1000)
    theirs.sendall(b"[" + b" " * 2000)
    with pytest.raises(GarbledError):
        parent.receive(1.0)


def test_bytes_that_come_one_by_one_keep_nobody_beyond_the_time(ends):
    parent, theirs = ends
    stop = threading.Event()

    def trickle():
        while not stop.wait(0.005):
            theirs.sendall(b"1")

    thread = threading.Thread(target=trickle)
    thread.start()
    try:
        with pytest.raises(TimeoutError):
            parent.receive(0.3)
    finally:
        stop.set()
        thread.join()


def test_a_child_that_takes_no_messages_does_not_keep_its_parent(monkeypatch):
    monkeypatch.setattr(messages, "_SEND_SECONDS", 0.2)
    ours, theirs = socket.socketpair()
    with ours, theirs, pytest.raises(OSError, match="timed out"):
        Correspondence(ours).send("x" * 10**7)


def test_a_process_that_was_forked_sends_nothing(ends, monkeypatch):
    parent, theirs = ends
    child = Messages(theirs)

    def end(status):
        raise SystemExit(status)

    monkeypatch.setattr(messages.os, "getpid", lambda: -1)
    monkeypatch.setattr(messages.os, "_exit", end)
    for doing in (lambda: child.send("from the other one"), child.receive):
        with pytest.raises(SystemExit):
            doing()
    monkeypatch.undo()
    child.send("from this one")
    assert parent.receive(1.0) == "from this one"
