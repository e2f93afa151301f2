"""Whole runs in processes of their own: what fails is recorded, what was stopped goes on."""

import errno
import os
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from helpers import toy_contest
from helpers.toy_contest import RULES, entry, tiny_instance

from mdpo_rddl.ipc import run as running
from mdpo_rddl.ipc.results import load_result
from mdpo_rddl.ipc.run import EntryTask, run, run_entry
from mdpo_rddl.machine.executors import LocalExecutor
from mdpo_rddl.machine.guarded import ProcessFailure

QUICK = replace(RULES, plan_seconds=15.0, trial_seconds=1.0)


def results(root, entries):
    return [load_result(root, each, RULES.trials) for each in entries]


def in_this_process(work, items, limits):
    """Stands for `run_guarded` where nothing fails."""
    assert limits(items[0]).seconds == RULES.plan_seconds
    for item in items:
        yield item, work(item)


def statuses(result):
    return [trial.status for trial in result.trials]


@pytest.fixture(scope="module")
def mishaps(tmp_path_factory):
    """A run in which one planner after the other fails in its own way."""
    folder = tmp_path_factory.mktemp("mishaps")
    problem = tiny_instance(folder / "tiny")
    kinds = ("Dying", "Hanging", "Raising")
    entries = [entry(problem, getattr(toy_contest, kind)) for kind in kinds]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CHILD_FILE", str(folder / "child"))
        run(folder / "out", entries, QUICK, LocalExecutor())
    return folder, entries, results(folder / "out", entries)


@pytest.mark.long
def test_every_failure_is_recorded_and_the_run_goes_on(mishaps):
    _, _, (dying, hanging, raising) = mishaps
    assert statuses(raising) == ["ok", "error", "ok"]
    assert raising.trials[1].cause == "step 0: RuntimeError: no plan for this"
    # there is no planner left to play with
    assert statuses(dying) == ["ok", "crash"]
    assert dying.trials[1].cause.startswith("exit status 3")
    assert statuses(hanging) == ["ok", "timeout"]
    assert hanging.trials[1].cause == "over 1 s"
    assert hanging.trials[1].seconds == pytest.approx(1.0, abs=0.9)
    assert all(result.is_complete for result in mishaps[2])


def test_a_planner_that_cannot_prepare_plays_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(running, "run_guarded", in_this_process)
    task = EntryTask(entry(tiny_instance(tmp_path), toy_contest.Unready), RULES, tmp_path / "out")
    run_entry(task)
    result = task.result
    assert result.is_complete
    assert result.trials == ()
    assert result.preparation is not None
    assert result.preparation.status == "error"
    assert result.preparation.cause == "ValueError: out of ideas"


def test_a_planner_leaves_no_process_behind(mishaps):
    folder, *_ = mishaps
    child = int((folder / "child").read_text())
    try:
        with open(f"/proc/{child}/stat", encoding="utf-8") as file:
            state = file.read().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return
    assert state == "Z"  # ended, and nobody has asked how


def test_each_trial_leaves_a_trace(mishaps):
    folder, entries, found = mishaps
    for each, result in zip(entries, found, strict=True):
        traces = sorted(each.folder(folder / "out" / "traces").glob("*"))
        played = [trial for trial in result.trials if trial.status in ("ok", "error")]
        assert [path.name for path in traces] == [f"trial-{t.trial:02}.npz" for t in played]
        for path, trial in zip(traces, played, strict=True):
            with np.load(path) as file:
                assert file["reward"].sum() == pytest.approx(trial.total)
                assert len(file["reward"]) == trial.steps
                if trial.steps:
                    assert file["state/x"].shape == file["action/push"].shape == (trial.steps, 2)


def test_a_finished_run_is_not_played_again(mishaps, monkeypatch):
    folder, entries, found = mishaps
    monkeypatch.setattr(running, "run_guarded", None)
    run(folder / "out", entries, QUICK, LocalExecutor())
    run_entry(EntryTask(entries[-1], QUICK, folder / "out"))
    assert results(folder / "out", entries) == found


@pytest.mark.long
def test_a_killed_run_keeps_the_trials_that_were_played(tmp_path):
    problem, out = tiny_instance(tmp_path / "tiny"), tmp_path / "out"
    each = entry(problem, toy_contest.Pausing)
    command = [sys.executable, "-m", "mdpo_rddl.cli.ipc", "run", "--out", str(out), "--quiet"]
    command += ["--problems", f"{problem.domain}:{problem.instance}", "--planners", each.planner]
    command += ["--trials", "40", "--plan-seconds", "60", "--memory-gb", "8"]
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    until, before = time.monotonic() + 90.0, ()
    with subprocess.Popen(command, env=variables, stdout=subprocess.DEVNULL) as process:
        while len(before) < 3 and time.monotonic() < until:
            time.sleep(0.05)
            before = load_result(out, each, 40).trials
        process.kill()
    kept = load_result(out, each, 40)
    assert 3 <= len(kept.trials) < 40
    assert kept.trials[: len(before)] == before
    assert statuses(kept) == ["ok"] * len(kept.trials)
    assert running.Contestant(each, RULES, out).prepared_folder.is_dir()


@pytest.mark.parametrize("kind", ["Remembering", "Erratic"])
def test_a_stopped_run_has_all_trials_from_one_preparation(tmp_path, monkeypatch, kind):
    task = EntryTask(
        entry(tiny_instance(tmp_path), getattr(toy_contest, kind)), RULES, tmp_path / "out"
    )
    monkeypatch.setattr(running, "run_guarded", in_this_process)
    saved = running.EntryResult.save

    def stopped(result, root):
        saved(result, root)
        if len(result.trials) == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(running.EntryResult, "save", stopped)
        with pytest.raises(KeyboardInterrupt):
            run_entry(task)
    before = task.result
    assert len(before.trials) == 2
    run_entry(task)
    after = task.result
    assert statuses(after) == ["ok"] * 3
    # what it had prepared is taken up, or all is done again
    is_kept = kind == "Remembering"
    assert (after.trials[:2] == before.trials) is is_kept
    if is_kept:
        assert after.preparation == before.preparation


def test_what_cannot_be_kept_is_played(tmp_path, monkeypatch, caplog):
    def full(planner, folder):
        (folder / "half").write_text("of it")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(running, "run_guarded", in_this_process)
    monkeypatch.setattr(toy_contest.Remembering, "save", full)
    each = entry(tiny_instance(tmp_path), toy_contest.Remembering)
    task = EntryTask(each, RULES, tmp_path / "out")
    run_entry(task)
    assert statuses(task.result) == ["ok"] * 3
    assert "its preparation is not kept: [Errno 28] No space left on device" in caplog.text
    folder = running.Contestant(each, RULES, task.root).prepared_folder
    assert [*folder.parent.iterdir()] == []


def test_what_cannot_be_taken_up_is_prepared_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(running, "run_guarded", in_this_process)
    each = entry(tiny_instance(tmp_path), toy_contest.Remembering)
    task = EntryTask(each, replace(RULES, trials=1), tmp_path / "out")
    contestant = running.Contestant(each, task.rules, task.root)
    contestant(running.PREPARE)
    (contestant.prepared_folder / "share").write_text("no number")
    running.EntryResult(each, 1, running.Preparation("ok", "", 0.1, 1.0)).save(task.root)
    run_entry(task)
    result = task.result
    assert statuses(result) == ["ok"]
    assert result.preparation is not None
    assert result.preparation.peak_mb > 1.0
    assert not contestant.prepared_folder.exists()


def test_who_improves_for_too_long_plays_what_was_kept(tmp_path, monkeypatch):
    began, phases = [], []

    def guarded(work, items, limits):
        began.append(work.improves)
        for item in items:
            phases.append((item, limits(item).seconds))
            if item == running.IMPROVE:
                work(item)
                yield item, ProcessFailure("timeout", "over 1 s", 1.0, 1.0)
                return
            yield item, work(item)

    monkeypatch.setattr(running, "run_guarded", guarded)
    each = entry(tiny_instance(tmp_path), toy_contest.Improver)
    task = EntryTask(each, replace(RULES, trials=1), tmp_path / "out")
    run_entry(task)
    assert statuses(task.result) == ["ok"]
    assert task.result.preparation.status == "ok"
    assert began == [True, False]
    assert [phase for phase, _ in phases] == [running.PREPARE, running.IMPROVE, running.RESTORE, 0]
    # it has what the preparation has left
    assert RULES.plan_seconds - 5.0 < phases[1][1] < RULES.plan_seconds


def test_a_stopped_run_does_not_improve_for_longer(tmp_path, monkeypatch):
    asked, phases = [], []

    def guarded(work, items, limits):
        for item in items:
            phases.append((item, limits(item).seconds))
            yield item, work(item)

    monkeypatch.setattr(running, "run_guarded", guarded)
    monkeypatch.setattr(toy_contest.Improver, "improve", lambda _, seconds: asked.append(seconds))
    each = entry(tiny_instance(tmp_path), toy_contest.Improver)
    task = EntryTask(each, replace(RULES, trials=1), tmp_path / "out")
    running.Contestant(each, task.rules, task.root)(running.PREPARE)
    used = 0.75 * RULES.plan_seconds
    running.EntryResult(each, 1, running.Preparation("ok", "", used, 1.0)).save(task.root)
    run_entry(task)
    assert statuses(task.result) == ["ok"]
    assert [phase for phase, _ in phases] == [running.RESTORE, running.IMPROVE, 0]
    left = RULES.plan_seconds - used
    assert phases[1][1] == left
    assert 0.0 < asked[0] < left


def test_the_trials_of_all_planners_meet_the_same_chance(tmp_path):
    problem = tiny_instance(tmp_path)
    task = EntryTask(entry(problem, toy_contest.Steady), RULES, tmp_path / "out")
    other = EntryTask(entry(problem, toy_contest.Exact), RULES, tmp_path / "out")
    states = []
    for each in (task, other):
        contestant = running.Contestant(each.entry, each.rules, each.root)
        contestant(running.PREPARE)
        contestant(1)
        path = each.entry.folder(each.root / "traces") / "trial-01.npz"
        with np.load(path) as file:
            states.append(file["state/x"][1] - file["action/push"][0])
    np.testing.assert_allclose(*states)
