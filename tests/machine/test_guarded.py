"""A guarded process: what it keeps, what it outlives, and limits of its own for each item."""

from helpers import workers
from helpers.processes import all_gone, is_alive

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
