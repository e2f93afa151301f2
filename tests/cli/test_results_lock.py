"""One process at a time writes into a results folder, where it is not shared on purpose."""

import argparse
import errno
import os
from pathlib import Path

import pytest
from helpers.files import contents
from helpers.mistakes import one_line

from benchmarks import main as bench
from mdpo_rddl.cli import ipc, ipc_commands
from mdpo_rddl.cli.results_lock import results_lock
from mdpo_rddl.machine.locks import RESULTS_LOCK, locked_results


@pytest.mark.parametrize(
    ("name", "main", "arguments"),
    [
        ("mdpo-ipc", ipc.main, ["run", "--problems", "HVAC_ippc2023:1", "--planners", "noop"]),
        ("mdpo-ipc", ipc.main, ["agent", "HVAC", "1", "noop", "1"]),
        ("benchmarks", bench.main, ["paper-preset"]),
    ],
)
def test_a_folder_in_use_is_refused_in_one_line(tmp_path, capsys, name, main, arguments):
    with locked_results(tmp_path):
        assert main([*arguments, "--out", str(tmp_path)]) == 2
        complaint = f"{tmp_path}: already in use by process {os.getpid()}"
        assert capsys.readouterr().err == f"{name}: error: {complaint}\n"
        assert os.listdir(tmp_path) == [RESULTS_LOCK]
    assert os.listdir(tmp_path) == []


def test_the_lock_is_held_while_planners_play_and_costs_a_new_folder_nothing(tmp_path, monkeypatch):
    out = tmp_path / "out"
    out.mkdir()
    (out / RESULTS_LOCK).write_text("1\n")  # of a process that was killed
    seen = []
    monkeypatch.setattr(ipc_commands, "run", lambda out, *_: seen.extend(os.listdir(out)))
    arguments = ["run", "--problems", "HVAC_ippc2023:1", "--planners", "noop"]
    assert ipc.main([*arguments, "--out", str(out)]) == 2  # nothing was played
    assert sorted(seen) == [RESULTS_LOCK, "run.json"]
    assert os.listdir(out) == ["run.json"]


@pytest.mark.parametrize(
    "shared",
    [
        {"executor": "slurm"},
        {"shard": (1, 2), "run": "published"},
        {"shard": (0, 3), "run": "noise-value"},
        {"report": True, "run": "noise-value"},
        {"run": "published-report"},
        {"run": "report"},
    ],
)
def test_shared_folders_and_reports_are_not_locked(tmp_path, shared):
    with locked_results(tmp_path), results_lock(argparse.Namespace(out=tmp_path, **shared)):
        assert os.listdir(tmp_path) == [RESULTS_LOCK]


def test_a_folder_that_stays_empty_is_removed_again_with_those_on_the_way_to_it(tmp_path):
    out = tmp_path / "runs" / "of" / "today"
    whole = argparse.Namespace(out=out, shard=(0, 1), run="noise-value", executor="local")
    with results_lock(whole):
        assert os.listdir(out) == [RESULTS_LOCK]
    assert os.listdir(tmp_path) == []
    with results_lock(whole):
        (out.parent / "yesterday").touch()
    assert contents(tmp_path) == {"runs": None, "runs/of": None, "runs/of/yesterday": b""}


def test_a_folder_that_cannot_be_locked_is_not_left_behind(tmp_path, monkeypatch):
    out = tmp_path / "runs" / "today"

    def full(path: Path, what: str) -> None:
        assert path.parent.is_dir()
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("mdpo_rddl.machine.locks.FolderLock", full)
    said = one_line(lambda: locked_results(out).__enter__())
    assert said == f"{out}: cannot be written: No space left on device"
    assert os.listdir(tmp_path) == []
