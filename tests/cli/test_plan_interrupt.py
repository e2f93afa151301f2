"""`mdpo-plan` interrupted: what was found is kept, or nothing is left."""

import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from helpers.files import contents
from helpers.plan_command import OPTIONS, RUN_FILES, TANKS, Outcome, run

from mdpo_rddl.cli import plan as command
from mdpo_rddl.planner.training import Progress
from mdpo_rddl.session.progress_bar import ProgressBar


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


# the progress bar shows nothing in time where standard error is no terminal
THAT_SAYS_WHEN_IT_TRAINS = """
import os, sys
from mdpo_rddl.cli import plan
from mdpo_rddl.session import progress_bar
progress_bar.ProgressBar.training = lambda bar, progress: os.write(1, b"training\\n")
sys.exit(plan.main(sys.argv[1:]))
"""


def test_sigterm_during_training_leaves_nothing(workplace: Path) -> None:
    before = contents(workplace)
    endless = f"{TANKS} --iterations 1000000000 --seconds 600 --out new/run --json"
    with subprocess.Popen(
        [sys.executable, "-c", THAT_SAYS_WHEN_IT_TRAINS, *endless.split()],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "training\n"
        (staging,) = (workplace / "new").iterdir()
        assert staging.name.startswith(".run-")
        process.terminate()
        out, err = process.communicate(timeout=60)
    assert set(out.splitlines()) <= {"training"}
    assert (process.returncode, err) == (143, "mdpo-plan: terminated, nothing was written\n")
    assert contents(workplace) == before


def test_another_sigterm_does_not_stop_the_clearing_away(
    workplace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cleared = []

    def terminate(bar: ProgressBar, name: str) -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            signal.raise_signal(signal.SIGTERM)
            cleared.append(name)

    monkeypatch.setattr(ProgressBar, "stage", terminate)
    handler = signal.getsignal(signal.SIGTERM)
    assert run(OPTIONS, capsys).status == 143
    assert cleared == ["compiling"]
    # and it is the caller's again
    assert signal.getsignal(signal.SIGTERM) is handler


def test_the_command_runs_in_a_thread_where_there_are_no_signals(workplace: Path) -> None:
    found: list[int] = []
    thread = threading.Thread(target=lambda: found.append(command.main(["no.rddl", "two.rddl"])))
    thread.start()
    thread.join()
    assert found == [2]
