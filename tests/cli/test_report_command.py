"""`mdpo-report`: the page of a run, and one that compares several."""

import shutil
from pathlib import Path

import pytest
from helpers.plan_command import Run

from mdpo_rddl.cli import report


def test_the_page_of_a_run_is_made_again(
    finished: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    shutil.copytree(finished.folder, run)
    before = (run / "report.html").read_text()
    (run / "report.html").unlink()
    assert report.main([str(run)]) == 0
    assert capsys.readouterr().out == f"written to {run}/report.html\n"
    assert (run / "report.html").read_text() == before
    # what the run itself has written says what was given
    assert "mdpo-plan tanks.rddl two.rddl --iterations 30" in before
    assert "volume(t1)" in before
    assert "Neither the no-op" not in before


def test_several_runs(finished: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(finished.folder, "a")
    shutil.copytree(finished.folder, "b")
    assert report.main(["a", "b"]) == 0
    assert "2 runs compared" in Path("comparison.html").read_text()
    assert report.main(["a", "b", "--out", "deep/page.html"]) == 0
    assert Path("deep/page.html").read_text() == Path("comparison.html").read_text()


def test_a_mistake_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert report.main([str(tmp_path)]) == 2
    said = f"mdpo-report: error: {tmp_path}: no run folder: it has no summary.json\n"
    assert capsys.readouterr() == ("", said)
