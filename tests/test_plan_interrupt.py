"""`mdpo-plan` interrupted: what was found is kept, or nothing is left."""

from pathlib import Path

import pytest
from files import contents
from plan_command import OPTIONS, RUN_FILES, Outcome, run

from mdpo_rddl.cli.display import ProgressBar
from mdpo_rddl.training import Progress


def test_an_interrupt_keeps_what_was_found(
    workplace: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(bar: ProgressBar, progress: Progress) -> None:
        if progress.iteration == 5:
            raise KeyboardInterrupt

    monkeypatch.setattr(ProgressBar, "training", interrupt)
    summary = run(f"{OPTIONS} --out run --quiet --json", capsys).summary
    assert (summary["status"], summary["iterations"]) == ("interrupted", 6)
    assert {path.name for path in (workplace / "run").iterdir()} == RUN_FILES


def test_an_interrupt_before_that_leaves_nothing(
    workplace: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(bar: ProgressBar, name: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(ProgressBar, "stage", interrupt)
    before = contents(workplace)
    outcome = run(f"{OPTIONS} --json", capsys)
    assert outcome == Outcome(130, "", "mdpo-plan: interrupted, nothing was written\n")
    assert contents(workplace) == before
