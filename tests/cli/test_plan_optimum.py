"""`mdpo-plan` where the optimum can be proven: what it prints, keeps and plays again."""

import csv
import json
import re
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from helpers import toy_mdps as toys
from helpers.plan_command import Outcome, Run, run

WALK = "walk.rddl walk_inst.rddl"
VALUE = -2.9375


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run in this process, which the tests look at and none changes."""
    from mdpo_rddl.planner.config.presets import PRESETS
    from mdpo_rddl.session.plan import plan
    from mdpo_rddl.session.requests import PlanRequest

    cwd = tmp_path_factory.mktemp("solved")
    problem = toys.walk(cwd, 6)
    request = PlanRequest(problem, PRESETS["auto"](""), "auto", 4, 50, cwd / "run")
    summary = plan(request, Silent())
    return Run(cwd, cwd / "run", Outcome(0, json.dumps(summary), ""))


class Silent:
    def stage(self, name: str) -> None:
        """Nobody listens."""

    def training(self, progress: object) -> None:
        raise AssertionError("nothing is trained")

    def racing(self, fraction: float) -> None:
        """Nobody listens."""

    def incumbent(self, found: object) -> None:
        """Nobody listens."""

    def episode(self, done: int, of: int) -> None:
        """Nobody listens."""


def test_the_summary_has_the_optimum(solved: Run) -> None:
    summary = solved.summary
    assert summary["optimum"]["value"] == pytest.approx(VALUE, abs=1e-12)
    assert summary["optimum"]["states"] == 5
    assert summary["optimum"]["transitions"] > 0
    assert summary["optimum"]["seconds"] > 0.0
    assert (summary["policy"], summary["noise"]) == ("table", "none")
    assert summary["status"] == "optimum_proven"
    assert summary["illegal_actions"] == 0
    assert list(summary["auto"]["arms"]) == ["dynamic programming"]
    error = summary["std_return"] / np.sqrt(50)
    assert abs(summary["mean_return"] - VALUE) < 4 * error


def test_the_folder_is_complete(solved: Run) -> None:
    names = {path.name for path in solved.folder.iterdir()}
    others = {"config.json", "candidates.csv", "learning_curve.png"}
    others |= {"trajectories.npz", "report.html"}
    assert names == {"summary.json", "policy.safetensors", *others}
    config = json.loads((solved.folder / "config.json").read_text())
    assert config["optimum"] == solved.summary["optimum"]
    # what was asked for
    assert "Search" in config["sections"]
    with (solved.folder / "candidates.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert float(row["mean_return"]) == solved.summary["optimum"]["value"]
    assert matplotlib.image.imread(solved.folder / "learning_curve.png").std() > 0.0


def test_a_loaded_table_returns_the_same_to_the_last_digit(
    solved: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(solved.cwd)
    outcome = run(f"{WALK} --load run --episodes 50 --json", capsys)
    same = ["returns", "mean_return", "policy", "noise", "seed", "illegal_actions"]
    assert {key: outcome.summary[key] for key in same} == {key: solved.summary[key] for key in same}
    # the file does not know how long it took
    assert outcome.summary["optimum"] == {**solved.summary["optimum"], "seconds": None}
    rows = dict(re.findall(r"│ (.+?)  +│ +(.+?) │", outcome.out))
    assert rows["proven optimum"] == "-2.94"
    assert rows["policy"] == "table"
    other = run(f"{WALK} --load run --episodes 50 --seed 9 --quiet --json", capsys).summary
    assert (other["seed"], other["optimum"]) == (9, outcome.summary["optimum"])
    assert other["returns"] != solved.summary["returns"]


def test_nothing_is_proven_of_another_horizon(
    solved: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(solved.cwd)
    arguments = f"{WALK} --load run --episodes 3 --horizon 4 --quiet --json"
    shorter = run(arguments, capsys).summary
    assert "optimum" not in shorter
    assert shorter["episode_lengths"] == [4, 4, 4]


def test_the_command_prints_the_optimum_beside_the_mean_return(
    solved: Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(solved.cwd)
    out = tmp_path / "run"
    outcome = run(f"{WALK} --seed 4 --episodes 50 --json --out {out}", capsys)
    assert outcome.summary["returns"] == solved.summary["returns"]
    rows = dict(re.findall(r"│ (.+?)  +│ +(.+?) │", outcome.out))
    assert rows["proven optimum"] == "-2.94"
    assert rows["reachable states"] == "5"
    assert rows["dynamic programming *"].endswith("6 iterations  best -2.94")
    assert "return of the no-op" not in rows
