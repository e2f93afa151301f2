"""Files and words that nobody means: one line and exit status 2, or they are accepted."""

from pathlib import Path

import pytest
from helpers.fuzzing import Fuzzer

from mdpo_rddl.errors import InputError
from mdpo_rddl.ipc import report

RELIABILITY = Path(__file__).parents[2] / "docs" / "reliability.md"
COUNTS = {
    "configuration": 600,
    "command line": 600,
    "policy file": 400,
    "policy contents": 100,
    "run of mdpo-ipc": 100,
    "RDDL": 200,
    "run folder": 8,
}


@pytest.mark.parametrize("kind", COUNTS)
def test_changed_inputs_are_refused_in_one_line_or_accepted(tmp_path, kind, monkeypatch):
    # the pictures take most of the time; `tools/fuzz.py` draws them
    monkeypatch.setattr(report, "draw_domains", lambda scores: b"")
    monkeypatch.setattr(report, "draw_profiles", lambda scores: b"")
    fuzzer = Fuzzer(tmp_path / "fuzz", seed=22)
    fuzzer.folder.mkdir()
    for _ in range(COUNTS[kind]):
        fuzzer.run(kind)
    assert fuzzer.failures == []
    refused, accepted = fuzzer.outcomes[kind]
    assert refused + accepted == COUNTS[kind]
    assert refused > 0
    assert kind != "run of mdpo-ipc" or accepted > 10  # they are scored
    assert [path.name for path in tmp_path.iterdir()] == ["fuzz"]


def test_every_kind_is_tried_and_as_many_inputs_as_is_said(tmp_path):
    assert set(COUNTS) == set(Fuzzer(tmp_path).kinds)
    thousands = sum(COUNTS.values()) // 1000
    assert f"{thousands},000 of them are among the tests" in RELIABILITY.read_text()


def test_a_traceback_and_an_empty_message_are_failures(tmp_path):
    fuzzer = Fuzzer(tmp_path)

    def stumble() -> None:
        raise KeyError("x")

    def say_nothing() -> None:
        raise InputError(" ")

    fuzzer.kinds |= {"stumble": stumble, "silence": say_nothing}
    fuzzer.run("stumble")
    fuzzer.run("silence")
    assert len(fuzzer.failures) == 2
    assert "KeyError" in fuzzer.failures[0]
    assert fuzzer.failures[1] == "silence: an empty message"
