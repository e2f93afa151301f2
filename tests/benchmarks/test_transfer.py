"""`python -m benchmarks transfer`: its rows, from races that are made up."""

from types import SimpleNamespace

import pytest
from helpers.mistakes import one_line

from benchmarks.presets import transfer
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.race.race import GIVEN


def race(*candidates):
    """A race whose candidates came with these seconds, labels and returns; the last one won."""
    points = [
        SimpleNamespace(seconds=seconds, candidate=SimpleNamespace(label=label), mean=mean)
        for seconds, label, mean in candidates
    ]
    policy = Policy(None, None, {}, {}, 0)
    return SimpleNamespace(points=points, policy=policy, noop_return=-9.0)


@pytest.fixture
def races(monkeypatch):
    """Source, cold and warm races of one pair after the other."""
    made = [
        race((1.0, "plan", 0.0)),
        race((2.0, "no-op", -9.0), (8.0, "plan", -2.0)),
        race((2.0, GIVEN, -3.0), (4.0, "plan", -1.5)),
        race((1.0, "plan", 0.0)),
        race((5.0, "plan", -2.0)),
        race((2.0, GIVEN, -4.0)),
    ]
    monkeypatch.setattr(transfer, "load_problem", lambda name, instance: (name, instance))
    monkeypatch.setattr(transfer, "accepted", lambda policy, problem: policy)
    monkeypatch.setattr(transfer, "_race", lambda *arguments, **keywords: made.pop(0))
    return made


def test_a_row_says_when_the_cold_start_is_reached(races, tmp_path):
    records = transfer.run_transfer(tmp_path, ["A:1:2", "B:1:3"], 60.0, 0)
    *_, first, second = transfer.transfer_table(records).splitlines()
    assert first == "| A | 1 | 2 | -9 | -3 | -2 | 8 s | 4 s |"
    assert second == "| B | 1 | 3 | -9 | -4 | -2 | 5 s | not reached |"
    # what is there is not made again
    assert transfer.run_transfer(tmp_path, ["A:1:2", "B:1:3"], 60.0, 0).rows == records.rows
    assert races == []


def test_a_pair_has_two_instances(tmp_path):
    said = one_line(lambda: transfer.run_transfer(tmp_path, ["A:1"], 60.0, 0))
    assert said == "A:1: must be Problem:instance:instance"
