"""A run: every planner on every instance, whatever becomes of each."""

import contextlib
import logging
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.ipc.contestant import IMPROVE, PREPARE, RESTORE, Contestant
from mdpo_rddl.ipc.results import (
    CRASH,
    EntryResult,
    Preparation,
    Trial,
    load_result,
    parse_preparation,
    parse_trial,
)
from mdpo_rddl.ipc.rules import Entry, Rules
from mdpo_rddl.ipc.trial import OK
from mdpo_rddl.machine.executors import Executor
from mdpo_rddl.machine.guarded import Limits, ProcessFailure, run_guarded

logger = logging.getLogger(__name__)

_NO_RESULT = "its process sent no result"
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
    _log(result)


def _go_on(result: EntryResult, contestant: Contestant) -> EntryResult:
    """Plays the missing trials; returns an empty result if nothing can be restored."""
    rules, prepared = contestant.rules, result.preparation
    first = PREPARE if result.preparation is None else RESTORE
    improving = [IMPROVE] if contestant.improves else []
    phases = [first, *improving, *range(len(result.trials), rules.trials)]
    limits = _PhaseLimits(rules)
    if prepared is not None:
        # what is restored was improved in no more time
        limits.prepared = contestant.prepared_seconds = prepared.seconds
    with contextlib.closing(run_guarded(contestant, phases, limits)) as outcomes:
        for phase, outcome in outcomes:
            if phase == RESTORE:
                if _failed(outcome):
                    return EntryResult(result.entry, result.wanted)
                continue
            if phase == IMPROVE:
                if not _is_improved(contestant, outcome):
                    kept = contestant.prepared_folder.is_dir()
                    return result if kept else EntryResult(result.entry, result.wanted)
                continue
            result, is_last = _recorded(result, phase, outcome, contestant.root)
            if phase == PREPARE and result.preparation is not None:
                limits.prepared = result.preparation.seconds
            if is_last:
                break
    if result.is_complete:  # the process has ended, and its temporary files are gone
        _finish(result, contestant)
    return result


class _PhaseLimits:
    """Of each phase; `IMPROVE` has what `prepared`, in seconds, has left."""

    def __init__(self, rules: Rules) -> None:
        self._rules, self.prepared = rules, 0.0

    def __call__(self, phase: int) -> Limits:
        rules = self._rules
        seconds = rules.plan_seconds if phase < 0 else rules.trial_seconds
        if phase == IMPROVE:
            seconds = max(seconds - self.prepared, _LEAST_SECONDS)
        return Limits(seconds, rules.memory_gb)


def _is_improved(contestant: Contestant, outcome: dict[str, Any] | ProcessFailure) -> bool:
    """Whether the process can go on to the trials; if not, the next one improves nothing."""
    if _failed(outcome):
        is_ended = isinstance(outcome, ProcessFailure)
        cause = outcome.cause if isinstance(outcome, ProcessFailure) else outcome.get("cause")
        logger.warning("%s: not improved: %s", contestant.entry.planner, cause)
        contestant.improves = not is_ended
    return contestant.improves


def _failed(outcome: dict[str, Any] | ProcessFailure) -> bool:
    return isinstance(outcome, ProcessFailure) or outcome.get("status") != OK


def _recorded(
    result: EntryResult, phase: int, outcome: dict[str, Any] | ProcessFailure, root: Path
) -> tuple[EntryResult, bool]:
    """The result with an outcome, saved, and whether the process is to end now."""
    found = _with_outcome(result, phase, outcome)
    if found.is_complete:
        return found, True
    try:
        found.save(root)
    except InputError as error:
        # the planner may have filled the disk: without it there is room again
        failure = ProcessFailure(CRASH, one_line_cause(error), 0.0, 0.0)
        return _with_outcome(result, phase, failure), True
    return found, False


def _finish(result: EntryResult, contestant: Contestant) -> None:
    """Saves what is complete, and removes what was prepared."""
    try:
        result.save(contestant.root)
    except InputError:
        # on a full disk that comes first
        shutil.rmtree(contestant.prepared_folder, ignore_errors=True)
        result.save(contestant.root)
    shutil.rmtree(contestant.prepared_folder, ignore_errors=True)


def _with_outcome(
    result: EntryResult, phase: int, outcome: dict[str, Any] | ProcessFailure
) -> EntryResult:
    if phase == PREPARE:
        return replace(result, preparation=_preparation(outcome))
    return result.with_trial(_trial(phase, outcome))


def _preparation(outcome: dict[str, Any] | ProcessFailure) -> Preparation:
    if isinstance(outcome, ProcessFailure):
        seconds, peak = round(outcome.seconds, 3), round(outcome.peak_mb)
        return Preparation(outcome.status, outcome.cause, seconds, peak)
    try:
        return parse_preparation(outcome)
    except (TypeError, ValueError):
        return Preparation(CRASH, _NO_RESULT, 0.0, 0.0)


def _trial(number: int, outcome: dict[str, Any] | ProcessFailure) -> Trial:
    if isinstance(outcome, ProcessFailure):
        seconds = round(outcome.seconds, 3)
        return Trial(number, outcome.status, outcome.cause, None, 0, 0, seconds)
    try:
        return parse_trial(outcome, number)
    except (TypeError, ValueError):
        return Trial(number, CRASH, _NO_RESULT, None, 0, 0, 0.0)


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
