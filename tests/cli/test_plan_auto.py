"""`mdpo-plan` with the preset `auto`: what it prints and what it leaves behind."""

import csv
import json
import re
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from helpers.plan_command import Run, in_a_process, refuse, run, write_problem

from mdpo_rddl.session.report.run_folder import RUN_FILES

TANKS = "tanks.rddl two.rddl"
OPTIONS = f"{TANKS} --episodes 3 --json"


@pytest.fixture(scope="module")
def raced(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """One run, which the tests look at and none changes."""
    cwd = tmp_path_factory.mktemp("raced")
    write_problem(cwd)
    return Run(cwd, cwd / "run", in_a_process(f"{OPTIONS} --seconds 6 --out run", cwd))


def test_it_is_the_default_and_the_policy_can_be_played_again(
    raced: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    summary = raced.summary
    assert summary["config"] == "auto"
    assert summary["policy"] == "feedback"
    assert summary["auto"]["noop_return"] < summary["mean_return"]
    monkeypatch.chdir(raced.cwd)
    again = run(f"{OPTIONS} --quiet --load run", capsys).summary
    assert again["returns"] == summary["returns"]
    assert again["noise"] == summary["noise"]


def test_the_time_is_counted_once(raced: Run) -> None:
    summary = raced.summary
    assert summary["train_seconds"] > 0.0
    # candidates are dated to a millisecond
    last = max(candidate["seconds"] for candidate in summary["auto"]["candidates"])
    seconds = summary["train_seconds"] + summary["compile_seconds"]
    assert last - 0.001 <= seconds
    # of one training only
    assert not {"best_iteration", "iterations", "restart", "last_iterate"} & set(summary)


def test_noise_is_shown_only_where_the_result_was_trained_with_it(raced: Run) -> None:
    summary = raced.summary
    race = summary["auto"]
    is_trained = "gradient" in (race["arm"], *race["parents"])
    assert (summary["noise"] == "adaptive") is is_trained
    assert bool(summary["noise_parameters"]) is is_trained
    assert ("action noise" in raced.outcome.out) is is_trained
    for name in ("noise.npy", "noise.png", "history.csv"):
        assert (raced.folder / name).exists() is is_trained


def test_the_table_has_a_row_for_each_arm_and_marks_the_results(raced: Run) -> None:
    rows = dict(re.findall(r"│ (.+?)  +│ +(.+?) │", raced.outcome.out))
    rows |= dict(re.findall(r"│ (\S.*? \*) +│ +(.+?) │", raced.outcome.out))
    race = raced.summary["auto"]
    for name, arm in race["arms"].items():
        row = rows[f"{name} *" if name == race["arm"] else name]
        assert row.startswith(f"{arm['seconds']:.1f} s  {arm['iterations']:,} iterations  best ")
        best = arm["best_return"]  # of an arm that has found something
        assert row.endswith("none" if best is None else f"{best:,.2f}")
    late = race["late_gain"]
    assert rows["gained in the last half"] == f"{late:.1%} of all gains"
    assert rows["result"].startswith(race["chosen"])
    assert "best iterate" not in raced.outcome.out


def test_the_folder_holds_all_candidates_and_their_picture(raced: Run) -> None:
    names = {path.name for path in raced.folder.iterdir()}
    noise = {"noise.npy", "noise.png", "history.csv"}
    assert names - noise == {
        "summary.json",
        "policy.safetensors",
        "config.json",
        "candidates.csv",
        "learning_curve.png",
        "trajectories.npz",
        "report.html",
    }
    with (raced.folder / "candidates.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    candidates = raced.summary["auto"]["candidates"]
    assert [row["candidate"] for row in rows] == [c["candidate"] for c in candidates]
    assert [float(row["mean_return"]) for row in rows] == [c["mean_return"] for c in candidates]
    image = matplotlib.image.imread(raced.folder / "learning_curve.png")[..., :3]
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 50
    config = json.loads((raced.folder / "config.json").read_text())
    assert config["source"] == "auto"
    assert "Search" not in config["sections"]


def test_an_earlier_run_can_be_replaced(raced: Run) -> None:
    assert {path.name for path in raced.folder.iterdir()} <= RUN_FILES


@pytest.mark.parametrize("option", ["--policy slp", "--noise none", "--iterations 5", "--replan"])
def test_options_for_one_training_do_not_go_with_it(
    option: str, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = f"{option.split()[0]} does not go with --preset auto, which chooses it"
    refuse(f"{TANKS} --preset auto {option}", said, workplace, capsys)
