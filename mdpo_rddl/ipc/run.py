"""A run: every planner on every instance, whatever becomes of each."""

import contextlib
import logging
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mdpo_rddl.ipc.contestant import IMPROVE, PREPARE, RESTORE, Contestant
from mdpo_rddl.ipc.results import EntryResult, Preparation, Trial, load_result
from mdpo_rddl.ipc.rules import Entry, Rules
from mdpo_rddl.ipc.trial import OK
from mdpo_rddl.machine.executors import Executor
from mdpo_rddl.machine.guarded import Limits, ProcessFailure, run_guarded

logger = logging.getLogger(__name__)

# for a planner with nothing to improve to say so
_LEAST_SECONDS = 1.0


@dataclass(frozen=True)
class EntryTask:
    """What there is to do for one entry.

    Attributes:
      entry: which planner and instance.
      rules: of the run.
      root: the run's folder.
    """

    entry: Entry
    rules: Rules
    root: Path

    @property
    def result(self) -> EntryResult:
        """What the folder knows of it."""
        return load_result(self.root, self.entry, self.rules.trials)


def run(root: Path, entries: Sequence[Entry], rules: Rules, executor: Executor) -> None:
    """Plays all entries; what the folder holds of them already is not played again.

    Args:
      root: the run's folder.
      entries: in the order of execution.
      rules: the same for all.
      executor: where it is done.

    Raises:
      InputError: if the folder cannot be written or a file in it is not a result.
    """
    tasks = [EntryTask(entry, rules, root) for entry in entries]
    executor.run(run_entry, [task for task in tasks if not task.result.is_complete])


def run_entry(task: EntryTask) -> None:
    """Prepares and plays one entry in a process of its own; goes on where it was left.

    A planner that was stopped between its trials restores what it had prepared. If it kept
    nothing, or cannot restore it, it begins again: all its trials are of one preparation.

    Raises:
      InputError: if the folder cannot be written or the entry's file is not a result.
    """
    result = task.result
    if result.is_complete:
        return
    contestant = Contestant(task.entry, task.rules, task.root)
    if result.preparation is not None and not contestant.prepared_folder.is_dir():
        result = EntryResult(task.entry, task.rules.trials)
    while not result.is_complete:
        result = _go_on(result, contestant)
    shutil.rmtree(contestant.prepared_folder, ignore_errors=True)
    _log(result)


def _go_on(result: EntryResult, contestant: Contestant) -> EntryResult:
    """Plays the missing trials; returns an empty result if nothing can be restored."""
    rules = contestant.rules
    first = PREPARE if result.preparation is None else RESTORE
    improving = [IMPROVE] if contestant.improves else []
    phases = [first, *improving, *range(len(result.trials), rules.trials)]
    prepared = 0.0

    def limits(phase: int) -> Limits:
        seconds = rules.plan_seconds if phase < 0 else rules.trial_seconds
        if phase == IMPROVE:
            seconds = max(seconds - prepared, _LEAST_SECONDS)
        return Limits(seconds, rules.memory_gb)

    with contextlib.closing(run_guarded(contestant, phases, limits)) as outcomes:
        for phase, outcome in outcomes:
            if phase == RESTORE:
                if isinstance(outcome, ProcessFailure) or outcome["status"] != OK:
                    return EntryResult(result.entry, result.wanted)
                continue
            if phase == IMPROVE:
                if isinstance(outcome, ProcessFailure) and contestant.prepared_folder.is_dir():
                    contestant.improves = False
                    return result
                continue
            if phase == PREPARE:
                result = replace(result, preparation=_preparation(outcome))
                prepared = result.preparation.seconds if result.preparation else 0.0
            else:
                result = result.with_trial(_trial(phase, outcome))
            result.save(contestant.root)
            if result.is_complete:
                break
    return result


def _preparation(outcome: dict[str, Any] | ProcessFailure) -> Preparation:
    if isinstance(outcome, ProcessFailure):
        seconds, peak = round(outcome.seconds, 3), round(outcome.peak_mb)
        return Preparation(outcome.status, outcome.cause, seconds, peak)
    return Preparation(**outcome)


def _trial(number: int, outcome: dict[str, Any] | ProcessFailure) -> Trial:
    if isinstance(outcome, ProcessFailure):
        seconds = round(outcome.seconds, 3)
        return Trial(number, outcome.status, outcome.cause, None, 0, 0, seconds)
    return Trial(**outcome)


def _log(result: EntryResult) -> None:
    entry, preparation = result.entry, result.preparation
    failures = [trial for trial in result.trials if trial.status != OK]
    if preparation is not None and preparation.status != OK:
        outcome = f"not prepared: {preparation.status}: {preparation.cause}"
    elif failures:
        first = failures[0]
        outcome = (
            f"{len(failures)} trials failed, first {first.trial}: {first.status}: {first.cause}"
        )
    else:
        mean = sum(trial.total or 0.0 for trial in result.trials) / len(result.trials)
        outcome = f"mean return {mean:,.4g} over {len(result.trials)} trials"
    logger.info(
        "%s %s, %s: %s", entry.problem.domain_label, entry.problem.label, entry.planner, outcome
    )
