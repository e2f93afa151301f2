"""Planners that crash, hang, leak, print, fork, forge or fill the disk cost their own entry."""

import os
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest
from helpers import hostile_planners, toy_contest
from helpers.toy_contest import RULES, entry, tiny_instance

from mdpo_rddl.cli import ipc
from mdpo_rddl.errors import InputError
from mdpo_rddl.ipc import run as running
from mdpo_rddl.ipc.results import load_result
from mdpo_rddl.ipc.run import EntryTask, run, run_entry
from mdpo_rddl.machine.executors import LocalExecutor
from mdpo_rddl.machine.guarded import ProcessFailure

KINDS = ("Crashing", "Leaving", "Hanging", "Leaking", "Printing", "Forking", "Garbling", "Filling")
QUICK = replace(RULES, plan_seconds=30.0, trial_seconds=8.0, memory_gb=1.5)


def play(folder, kinds, rules=QUICK):
    """The results of hostile planners and of an honest one after them."""
    problem = tiny_instance(folder / "tiny")
    entries = [entry(problem, getattr(hostile_planners, kind)) for kind in kinds]
    entries.append(entry(problem, toy_contest.Steady))
    run(folder / "out", entries, rules, LocalExecutor())
    found = [load_result(folder / "out", each, rules.trials) for each in entries]
    return dict(zip((*kinds, "honest"), found, strict=True))


def ends(result):
    return [(trial.status, trial.cause) for trial in result.trials]


OK = ("ok", "")


@pytest.mark.long
@pytest.mark.timeout(300)
def test_each_costs_its_own_entry_only(tmp_path):
    found = play(tmp_path, KINDS)
    assert all(result.is_complete for result in found.values())
    second = {kind: ends(found[kind])[1:] for kind in KINDS}
    assert {kind: ends(found[kind])[0] for kind in KINDS} == dict.fromkeys(KINDS, OK)
    assert second["Crashing"][0][1].startswith("killed by SIG")
    assert second["Leaving"] == [("crash", "exit status 0")]
    assert second["Hanging"] == [("timeout", "over 8 s")]
    assert second["Leaking"] == [("memory", "over 1.5 GB")]
    # these can play on
    assert second["Printing"] == [OK, OK]
    assert second["Forking"] == [OK, OK]
    assert second["Garbling"] == [("crash", "its process sent no result")]
    assert second["Filling"] == [("error", "step 0: OSError: [Errno 27] File too large"), OK]
    assert ends(found["honest"]) == [OK] * 3
    assert found["Forking"].trials == tuple(
        replace(trial, seconds=again.seconds)
        for trial, again in zip(found["honest"].trials, found["Forking"].trials, strict=True)
    )


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 24 MB, with the run's folder and temporary files."""
    folder = tmp_path / "small"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=24m", "tmpfs", str(folder)]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("no file system can be mounted here")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


@pytest.mark.long
def test_a_planner_that_fills_the_disk_gives_it_back(small_disk, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(small_disk))
    found = play(small_disk, ["Hoarding"])
    assert [status for status, _ in ends(found["Hoarding"])] == ["ok", "crash"]
    assert "No space left on device" in ends(found["Hoarding"])[1][1]
    assert ends(found["honest"]) == [OK] * 3
    files = os.statvfs(small_disk)
    assert files.f_bavail * files.f_bsize > 20 * 2**20


def played(phase, outcome):
    """What stands for `run_guarded`, with one outcome of its own."""

    def guarded(work, items, limits):
        for item in items:
            yield item, outcome if item == phase else work(item)

    return guarded


READY = {"status": "ok", "cause": "", "seconds": 1.0, "peak_mb": 1}


@pytest.mark.parametrize(
    "outcome",
    [
        {},
        {**READY, "more": 1},
        {**READY, "seconds": float("nan")},
        {**READY, "seconds": 10**400},
        {**READY, "status": ["ok"]},
    ],
)
def test_a_preparation_that_is_none_is_a_crash(tmp_path, monkeypatch, outcome):
    monkeypatch.setattr(running, "run_guarded", played(running.PREPARE, outcome))
    task = EntryTask(entry(tiny_instance(tmp_path / "tiny"), toy_contest.Steady), RULES, tmp_path)
    run_entry(task)
    assert task.result.preparation is not None
    status, cause = task.result.preparation.status, task.result.preparation.cause
    assert (status, cause) == ("crash", "its process sent no result")
    assert task.result.trials == ()


TRIAL = {"trial": 1, "status": "ok", "cause": "", "total": 1.0, "steps": 3, "violations": 0}


@pytest.mark.parametrize(
    "outcome",
    [
        TRIAL,
        {**TRIAL, "seconds": 1.0, "trial": 0},
        {**TRIAL, "seconds": 1.0, "total": None},
        {**TRIAL, "seconds": 1.0, "total": "a lot"},
        {**TRIAL, "seconds": 1.0, "total": float("inf")},
        {**TRIAL, "seconds": True},
    ],
)
def test_a_trial_that_is_none_is_a_crash(tmp_path, monkeypatch, outcome):
    monkeypatch.setattr(running, "run_guarded", played(1, outcome))
    task = EntryTask(entry(tiny_instance(tmp_path / "tiny"), toy_contest.Steady), RULES, tmp_path)
    run_entry(task)
    assert ends(task.result) == [OK, ("crash", "its process sent no result")]


def test_the_entry_says_which_episode_failed(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(running, "run_guarded", played(1, TRIAL))
    problem = tiny_instance(tmp_path / "tiny")
    planner = "helpers.toy_contest:Steady"
    arguments = ["agent", problem.domain, problem.instance, planner, "2"]
    assert ipc.main([*arguments, "--out", str(tmp_path / "out"), "--plan-seconds", "60"]) == 1
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("episode 1 ended with return -")
    assert second == "episode 2 ended with return None (crash: its process sent no result)"


def test_a_result_that_cannot_be_written_is_charged_to_who_plays(tmp_path, monkeypatch):
    monkeypatch.setattr(running, "run_guarded", played(-9, {}))
    saved, full = running.EntryResult.save, []

    def save(result, root):
        if len(result.trials) == 2 and not full:
            full.append(result)
            raise InputError("out: cannot be written: No space left on device")
        saved(result, root)

    monkeypatch.setattr(running.EntryResult, "save", save)
    task = EntryTask(entry(tiny_instance(tmp_path / "tiny"), toy_contest.Steady), RULES, tmp_path)
    run_entry(task)
    crash = ("crash", "out: cannot be written: No space left on device")
    assert ends(task.result) == [OK, crash]
    assert not Path(running.Contestant(task.entry, RULES, tmp_path).prepared_folder).exists()


def test_a_process_that_fails_to_restore_with_nonsense_is_prepared_anew(tmp_path, monkeypatch):
    calls = []

    def guarded(work, items, limits):
        calls.append(items[0])
        for item in items:
            yield item, {} if item == running.RESTORE else work(item)

    monkeypatch.setattr(running, "run_guarded", guarded)
    each = entry(tiny_instance(tmp_path / "tiny"), toy_contest.Remembering)
    task = EntryTask(each, replace(RULES, trials=1), tmp_path)
    running.Contestant(each, task.rules, task.root)(running.PREPARE)
    running.EntryResult(each, 1, running.Preparation("ok", "", 0.1, 1.0)).save(task.root)
    run_entry(task)
    assert calls == [running.RESTORE, running.PREPARE]
    assert ends(task.result) == [OK]


def test_a_failure_of_the_process_is_kept_as_it_is(tmp_path, monkeypatch):
    failure = ProcessFailure("memory", "over 1 GB", 2.0, 1000.0)
    monkeypatch.setattr(running, "run_guarded", played(2, failure))
    task = EntryTask(entry(tiny_instance(tmp_path / "tiny"), toy_contest.Steady), RULES, tmp_path)
    run_entry(task)
    assert ends(task.result) == [OK, OK, ("memory", "over 1 GB")]
