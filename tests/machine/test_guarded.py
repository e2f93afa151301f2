"""A guarded process: what it keeps, what it outlives, and limits of its own for each item."""

import os
from pathlib import Path

from helpers import hostile_work, workers
from helpers.processes import all_gone, is_alive

from mdpo_rddl.machine import child, guarded
from mdpo_rddl.machine.guarded import Limits, ProcessFailure, run_guarded


def limits(item):
    return Limits(seconds=1.0 if item == "hang" else 60.0, memory_gb=8.0)


def test_an_object_keeps_its_state_and_each_item_has_its_limits():
    outcomes = list(
        run_guarded(workers.Counting(), ["one", "signals", "two", "hang", "new"], limits)
    )
    assert [item for item, _ in outcomes] == ["one", "signals", "two", "hang", "new"]
    failed = [isinstance(outcome, ProcessFailure) for _, outcome in outcomes]
    assert failed == [False, False, False, True, False]
    hanging = outcomes[3][1]
    assert (hanging.status, hanging.cause) == ("timeout", "over 1 s")
    counts = [outcomes[number][1]["count"] for number in (0, 1, 2, 4)]
    # the last one is in a process of its own
    assert counts == [1, 2, 3, 1]
    # a signal for the whole cluster job is left to the parent, but not what the work starts
    assert outcomes[1][1]["child"] == -15


def test_the_memory_of_everything_that_it_has_started_counts_and_once():
    items = ["hoarding child", "sharing children"]
    (_, hoarding), (_, sharing) = run_guarded(workers.spread, items, Limits(60.0, 1.0))
    assert isinstance(hoarding, ProcessFailure)
    assert (hoarding.status, hoarding.cause) == ("memory", "over 1 GB")
    assert hoarding.peak_mb * 2**20 > 1e9
    assert sharing == {"bytes": 3 * 10**8}


def test_what_it_has_started_ends_with_it():
    outcomes = run_guarded(workers.Starting(), ["one", "two"], limits)
    _, found = next(outcomes)
    assert is_alive(found["child"])
    outcomes.close()
    assert all_gone([found["child"], found["worker"]], 10.0)


def outcomes_of(items, seconds=60.0):
    """What becomes of each item: its count, or how its process ended."""
    found = {}
    for item, outcome in run_guarded(hostile_work.Sending(), items, Limits(seconds, 8.0)):
        failed = isinstance(outcome, ProcessFailure)
        found[item] = (outcome.status, outcome.cause) if failed else outcome["count"]
    return found


def test_messages_that_are_repeated_or_come_from_a_forked_process_are_left_out():
    items = ["first", "repeated", "forked", "last"]
    # each has its own answer, from the one process
    assert outcomes_of(items) == {"first": 1, "repeated": 2, "forked": 3, "last": 4}


def test_a_process_that_sends_something_else_costs_its_item_only():
    items = ["garbled", "a", "nested", "early", "another", "b"]
    no_message = ("crash", "it sent what is no message")
    no_answer = ("crash", "it sent what is no answer")
    assert outcomes_of(items) == {
        "garbled": no_message,
        "a": 1,
        "nested": no_message,
        "early": no_answer,
        "another": no_answer,
        "b": 1,
    }


def test_messages_that_do_not_end_are_not_waited_for():
    late = ("timeout", "over 1 s")
    assert outcomes_of(["cut", "trickle", "next"], 1.0) == {"cut": late, "trickle": late, "next": 1}


def test_what_a_process_prints_and_writes_is_bounded(monkeypatch):
    monkeypatch.setattr(child, "_MOST_LOG", 2**20)
    sizes = []
    cut_log = child.Child._cut_log

    def watched(self):
        cut_log(self)
        sizes.append(os.fstat(self._log.fileno()).st_size)

    monkeypatch.setattr(child.Child, "_cut_log", watched)
    found = outcomes_of(["printing", "large file", "cleaning", "next"])
    assert found["printing"] == 1
    assert found["large file"] == ("crash", "exit status 1: OSError: [Errno 27] File too large")
    assert found["cleaning"][0] == "crash"
    assert found["next"] == 1
    assert sizes
    assert max(sizes) <= 2**20


def test_its_temporary_files_go_with_it():
    ((_, outcome),) = run_guarded(hostile_work.Sending(), ["one"], limits)
    assert not Path(outcome["folder"]).exists()


def test_a_process_that_starts_more_and_more_is_ended(monkeypatch):
    monkeypatch.setattr(guarded, "_MOST_PROCESSES", 20)
    assert outcomes_of(["many", "next"]) == {"many": ("crash", "over 20 processes"), "next": 1}
