"""Names of files that are no UTF-8, or that no terminal shows: whatever they are, a run is kept."""

import os
import shutil
from pathlib import Path

from helpers.tanks import DOMAIN, INSTANCE

from mdpo_rddl.errors import printable
from mdpo_rddl.planner.training.training import Record
from mdpo_rddl.problem.files import read_problem
from mdpo_rddl.session.report.figures import draw_learning_curve
from mdpo_rddl.session.report.page.write import write_comparison, write_page
from mdpo_rddl.session.report.run_folder import SUMMARY, write_json


def run_folder(folder: Path, label: str) -> Path:
    folder.mkdir()
    figures = {"returns": [1.0, 2.0], "mean_return": 1.5, "std_return": 0.5, "ci95": None}
    problem = {"domain": "d", "instance": "i", "label": label, "horizon": 3, "policy": "slp"}
    about = {"seed": 0, "episodes": 2, "config": "paper", "noise": "none", "noise_parameters": {}}
    counts = {"illegal_actions": 0, "fallback_actions": 0, "episode_lengths": [3, 3]}
    command = f"mdpo-plan tanks.rddl {os.fsdecode(b'x')}\udcff.rddl"
    write_json(folder / SUMMARY, {**problem, **about, **figures, **counts, "command": command})
    return folder


def test_a_problem_is_called_by_what_can_be_shown_of_its_files_name(tmp_path):
    (tmp_path / "tanks.rddl").write_text(DOMAIN)
    instance = tmp_path / os.fsdecode(b"x\xff\x1b[31m.rddl")
    instance.write_text(INSTANCE)
    label = read_problem(str(tmp_path / "tanks.rddl"), str(instance)).label
    assert label == "x\\udcff\\x1b[31m"
    history = [Record(number, 1.0, 2.0, 0.5) for number in range(2)]
    draw_learning_curve(tmp_path / "curve.png", history, 1, label)
    assert (tmp_path / "curve.png").read_bytes().startswith(b"\x89PNG")


def test_names_that_can_be_shown_stay():
    assert printable("Résumé 水槽 $x$_1") == "Résumé 水槽 $x$_1"


def test_a_page_is_written_whatever_the_files_are_called(tmp_path):
    first = run_folder(tmp_path / os.fsdecode(b"a\xff"), "x\ufffd")
    second = shutil.copytree(first, tmp_path / "b")
    assert "a\\udcff" in write_page(first).read_text(encoding="utf-8")
    page = write_comparison([first, second], tmp_path / os.fsdecode(b"c\xff.html"))
    assert "a\\udcff" in page.read_text(encoding="utf-8")
