"""A guarded process: what it keeps, what it outlives, and limits of its own for each item."""

from helpers import workers

from mdpo_rddl.machine.guarded import Death, Limits, run_guarded


def limits(item):
    return Limits(seconds=1.0 if item == "hang" else 60.0, memory_gb=8.0)


def test_an_object_keeps_its_state_and_each_item_has_its_limits():
    outcomes = list(
        run_guarded(workers.Counting(), ["one", "signals", "two", "hang", "new"], limits)
    )
    assert [item for item, _ in outcomes] == ["one", "signals", "two", "hang", "new"]
    counts = [
        outcome if isinstance(outcome, Death) else outcome["count"] for _, outcome in outcomes
    ]
    assert counts[:3] == [1, 2, 3]
    assert isinstance(counts[3], Death)
    assert (counts[3].status, counts[3].cause) == ("timeout", "over 1 s")
    # a process of its own after the death of the first
    assert counts[4] == 1
    # a signal for the whole cluster job is left to the parent, but not what the work starts
    assert outcomes[1][1]["child"] == -15
