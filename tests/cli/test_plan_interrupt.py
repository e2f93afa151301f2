"""`mdpo-plan` interrupted: what was found is kept, or nothing is left."""

import json
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from helpers.files import contents
from helpers.plan_command import OPTIONS, RUN_FILES, TANKS, Outcome, run
from helpers.problems import assert_same_bits
from safetensors.numpy import load_file

from mdpo_rddl.cli import plan as command
from mdpo_rddl.planner.training.training import Progress
from mdpo_rddl.session import movie
from mdpo_rddl.session.progress_bar import ProgressBar
from mdpo_rddl.session.report.run_folder import POLICY, RunFolder


@pytest.mark.long
def test_an_interrupt_keeps_what_was_found(
    workplace: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(bar: ProgressBar, progress: Progress) -> None:
        if progress.iteration == 5:
            raise KeyboardInterrupt

    monkeypatch.setattr(ProgressBar, "training", interrupt)
    outcome = run(f"{OPTIONS} --out run --quiet --json", capsys)
    summary = json.loads(outcome.out)
    assert outcome.status == 130
    assert (summary["status"], summary["iterations"]) == ("interrupted", 6)
    assert {path.name for path in (workplace / "run").iterdir()} == RUN_FILES
    command = f"mdpo-plan {OPTIONS} --out run --quiet --json --resume"
    assert outcome.err == f"mdpo-plan: stopped early, go on with: {command}\n"

    monkeypatch.undo()
    monkeypatch.chdir(workplace)
    whole = run(f"{OPTIONS} --out whole --quiet --json", capsys).summary
    resumed = run(command.removeprefix("mdpo-plan "), capsys).summary
    assert not (workplace / "run.unfinished").exists()
    for name in ("history.csv", "noise.npy"):
        assert (workplace / "run" / name).read_bytes() == (workplace / "whole" / name).read_bytes()
    assert_same_bits(*(load_file(workplace / name / POLICY) for name in ("run", "whole")))
    for figure in ("mean_return", "iterations", "best_iteration", "status"):
        assert resumed[figure] == whole[figure]


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


def test_an_interrupt_of_the_evaluation_keeps_its_episodes_so_far(
    workplace: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(bar: ProgressBar, done: int, of: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(ProgressBar, "episode", interrupt)
    outcome = run(f"{TANKS} --seconds 0.5 --out run --quiet --json", capsys)
    assert outcome.status == 130
    summary = json.loads(outcome.out)
    assert summary["status"] == "interrupted"
    assert len(summary["returns"]) == summary["episodes"] == 2
    # the race is not run again
    assert outcome.err.endswith("--resume\n")
    assert (workplace / "run" / "report.html").exists()


def test_a_race_that_is_interrupted_at_once_leaves_the_no_op(
    workplace: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(bar: ProgressBar, name: str) -> None:
        if name == "probing":
            raise KeyboardInterrupt

    monkeypatch.setattr(ProgressBar, "stage", interrupt)
    monkeypatch.setattr(ProgressBar, "episode", lambda bar, done, of: None)
    outcome = run(f"{TANKS} --seconds 600 --out run --quiet --json", capsys)
    assert outcome.status == 130
    summary = json.loads(outcome.out)
    assert (summary["status"], summary["auto"]["chosen"]) == ("interrupted", "no-op")
    assert (workplace / "run" / POLICY).exists()


def test_an_interrupt_while_the_movie_is_drawn_leaves_the_run(
    workplace: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(movie, "write_movie", lambda *_: signal.raise_signal(signal.SIGINT))
    outcome = run(f"{OPTIONS} --iterations 2 --out run --movie a.gif --quiet --json", capsys)
    assert outcome.status == 130
    assert outcome.err == "mdpo-plan: stopped after the run was done: run\n"
    assert json.loads(outcome.out)["status"] == "iter_budget_reached"
    assert {path.name for path in (workplace / "run").iterdir()} == RUN_FILES
    assert not (workplace / "run.unfinished").exists()


# the progress bar shows nothing in time where standard error is no terminal
THAT_SAYS_WHEN_IT_TRAINS = """
import os, sys
from mdpo_rddl.cli import plan
from mdpo_rddl.session import progress_bar
progress_bar.ProgressBar.training = lambda bar, progress: os.write(1, b"training\\n")
sys.exit(plan.main(sys.argv[1:]))
"""

THAT_DOES_NOT_LISTEN = """
import os, sys, time
from mdpo_rddl.cli import plan
from mdpo_rddl.session import progress_bar
def stage(bar, name):
    told = False
    while True:
        try:
            told = told or os.write(1, b"busy\\n")
            time.sleep(60)
        except KeyboardInterrupt:
            pass
progress_bar.ProgressBar.stage = stage
sys.exit(plan.main(sys.argv[1:]))
"""


def test_sigterm_during_training_keeps_what_was_found(workplace: Path) -> None:
    before = contents(workplace)
    endless = f"{TANKS} --iterations 1000000000 --seconds 600 --out new/run --quiet --json"
    with subprocess.Popen(
        [sys.executable, "-c", THAT_SAYS_WHEN_IT_TRAINS, *endless.split()],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "training\n"
        assert [path.name for path in (workplace / "new").iterdir()] == ["run.unfinished"]
        process.terminate()
        out, err = process.communicate(timeout=60)
    *lines, summary = out.splitlines()
    assert set(lines) <= {"training"}
    assert json.loads(summary)["status"] == "interrupted"
    assert process.returncode == 143
    assert err == f"mdpo-plan: stopped early, go on with: mdpo-plan {endless} --resume\n"
    after = contents(workplace)
    assert before.items() <= after.items()
    assert "new/run/summary.json" in after
    assert {Path(name).parts[0] for name in set(after) - set(before)} == {"new"}


def test_a_second_signal_ends_the_process_at_once(workplace: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", THAT_DOES_NOT_LISTEN, *OPTIONS.split(), "--out", "run"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "busy\n"
        process.terminate()
        time.sleep(0.2)
        process.terminate()  # as GNU timeout does: the same request
        time.sleep(1.2)
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert err.endswith("mdpo-plan: stopped at once; what was kept before stays\n")
    # the lock is not held any more, and what is left is cleared away by the next run
    with RunFolder(workplace / "run"):
        pass
    assert not (workplace / "run.unfinished").exists()


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


SWALLOWED = """
import gc, os, signal, sys
from mdpo_rddl.cli.termination import stopped_in_two_steps
def swallow(phase, info):
    gc.callbacks.remove(swallow)
    os.kill(os.getpid(), signal.SIGTERM)
    [None for _ in range(1000)]
with stopped_in_two_steps("mdpo-plan") as stop:
    gc.callbacks.append(swallow)
    gc.collect()
    print(stop.is_wanted, stop.status)
"""


def test_a_signal_that_python_swallows_is_neither_lost_nor_printed() -> None:
    done = subprocess.run(
        [sys.executable, "-c", SWALLOWED], capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.stderr, done.returncode) == ("True 143\n", "", 0)
