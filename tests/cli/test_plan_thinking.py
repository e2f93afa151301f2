"""`mdpo-plan --decision-seconds`: the prepared policy thinks where that pays."""

import json
from pathlib import Path

import pytest
from helpers.plan_command import TANKS, refuse, run, workplace  # noqa: F401
from helpers.toys import FOLDER

from mdpo_rddl.policy.lookahead import choice as choosing

WORDS = {
    "LIKELIHOOD": "1.0",
    "MOST": "pos-inf",
    "DISCOUNT": "1.0",
    "RULES": "forall_{?a : arm} [pull(?a) => true];",
    "TERMINATION": "false",
}
FIGURES = {
    "decision_seconds",
    "method",
    "reason",
    "prepare_seconds",
    "trials",
    "decisions",
    "left_base",
    "replaced",
    "mean_seconds",
    "p99_seconds",
    "max_seconds",
    "within_budget",
    "unmatched_beliefs",
    "expected_gain",
    "plain_mean_return",
    "realised_gain",
    "realised_gain_error",
}


def write_lever(folder: Path) -> str:
    text = (FOLDER / "lever.rddl").read_text()
    for word, value in WORDS.items():
        text = text.replace(word, value)
    domain, _, instance = text.partition("non-fluents nf ")
    (folder / "lever.rddl").write_text(domain)
    (folder / "one.rddl").write_text("non-fluents nf " + instance)
    return "lever.rddl one.rddl"


@pytest.mark.long
def test_thinking_is_played_and_told_also_from_a_saved_policy(workplace, capsys):  # noqa: F811
    problem = write_lever(workplace)
    options = "--episodes 2 --decision-seconds 1 --json"
    outcome = run(f"{problem} --policy slp --iterations 1 --out run {options}", capsys)
    summary = outcome.summary
    thinking = summary["thinking"]
    assert set(thinking) == FIGURES
    assert thinking["method"] in ("first actions", "coordinate-wise", "sequences")
    assert thinking["decisions"] == 8
    assert thinking["left_base"] > 0
    # nothing is random: the first and the third arm at each step
    assert summary["returns"] == [16.0, 16.0]
    gain = summary["mean_return"] - thinking["plain_mean_return"]
    assert thinking["realised_gain"] == pytest.approx(gain)
    assert thinking["realised_gain"] > 0.0
    assert "gain of an episode" in outcome.out
    assert json.loads((workplace / "run" / "summary.json").read_text()) == summary

    loaded = run(f"{problem} --load run {options}", capsys).summary
    assert loaded["returns"] == [16.0, 16.0]
    assert loaded["thinking"]["plain_mean_return"] == thinking["plain_mean_return"]
    alone = run(f"{problem} --load run --episodes 2 --json", capsys).summary
    assert "thinking" not in alone
    assert alone["mean_return"] == thinking["plain_mean_return"]


def test_where_no_method_applies_the_policy_plays_alone(
    workplace,  # noqa: F811
    capsys,
    monkeypatch,
):
    monkeypatch.setattr(choosing, "_methods", lambda: [])
    options = "--iterations 2 --episodes 2 --out run --json"
    outcome = run(f"{TANKS} {options} --decision-seconds 0.1", capsys)
    thinking = outcome.summary["thinking"]
    assert thinking["method"] is None
    assert thinking["reason"] == "no method changes such actions"
    assert "no method changes such actions" in outcome.out
    assert len(outcome.summary["returns"]) == 2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--decision-seconds -1", "argument --decision-seconds: must be a number at least 0"),
        (
            "--replan --decision-seconds 1",
            "--decision-seconds does not go with --replan, whose time is --seconds",
        ),
        (
            "--config replan --decision-seconds 1",
            "--decision-seconds does not go with --replan, whose time is --seconds",
        ),
        ("--config replan --out run --resume", "--resume goes with planning once, not with"),
        ("--config replan --movie a.gif", "--movie does not go with --replan, which plans anew"),
        ("--config replan --start-from run", "--start-from does not go with --replan"),
    ],
)
def test_what_thinking_does_not_go_with(options, said, workplace, capsys):  # noqa: F811
    refuse(f"{TANKS} {options}", said, workplace, capsys, start=True)
