"""`mdpo-plan` where a state has no legal action: what it prints, keeps, and refuses."""

import json
from pathlib import Path

import pytest
from helpers.plan_command import refuse, run
from helpers.toys import toy_text

PIT = {"RISK": "1.0", "REST": "0.0", "FALLEN": "false", "DISCOUNT": "1.0"}


def write(folder: Path, **changes: str) -> str:
    text = toy_text("pit", **PIT | changes)
    domain, rest = text.split("\n\nnon-fluents nf", 1)
    (folder / "pit.rddl").write_text(domain)
    (folder / "one.rddl").write_text("non-fluents nf" + rest)
    return "pit.rddl one.rddl"


def test_a_plan_that_avoids_it_says_how_often_the_references_do_not(
    workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ended = run(f"{write(workplace)} --seconds 5 --episodes 3 --out run", capsys)
    assert ended.status == 0
    assert "proven optimum" in ended.out
    assert "cannot be executed" not in ended.out
    # the no-op is illegal at the first of four steps, falls there, and nothing is legal after that
    assert "illegal steps of the no-op" in ended.out
    summary = json.loads((workplace / "run" / "summary.json").read_text())
    assert summary["returns"] == [11.0] * 3
    assert (summary["illegal_actions"], summary["unplayable_steps"]) == (0, 0)
    noop = summary["references"]["noop"]
    assert noop["illegal_actions"] == noop["steps"] == 4 * len(noop["returns"])
    told = f"{noop['steps']:,} of {noop['steps']:,}"
    assert told in ended.out
    assert (
        f"At {told} steps the no-op was illegal" in (workplace / "run" / "report.html").read_text()
    )
    assert summary["warnings"] == []


def test_a_plan_that_cannot_is_no_result(
    workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = write(workplace, REST="1.0")
    ended = run(f"{files} --seconds 5 --episodes 3 --out run", capsys)
    assert ended.status == 0
    assert "no legal action at 9 of 12 steps" in ended.out
    assert "~fallen" in ended.out
    summary = json.loads((workplace / "run" / "summary.json").read_text())
    assert summary["unmet_preconditions"] == ["~fallen"]
    told = (
        "the plan cannot be executed: at 9 of 12 steps no legal action was found, by the "
        "precondition ~fallen"
    )
    assert told in summary["warnings"]
    assert told in (workplace / "run" / "report.html").read_text()


def test_an_initial_state_without_a_legal_action_is_refused(
    workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = write(workplace, FALLEN="true")
    said = "one.rddl: no action is legal in the initial state, by the precondition ~fallen"
    refuse(f"{files} --seconds 5 --out run", said, workplace, capsys)
