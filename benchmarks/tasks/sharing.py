"""Where time is better spent: at the decisions, or before the first of them.

Ours prepares for a while and may then think at its decisions. Where it chose to, the same task is
prepared once more, longer by the time of the decisions of all episodes, of some, or of none, and
the policy is played alone.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.common.markdown import rounded, table_head, table_row
from benchmarks.common.records import Records
from benchmarks.tasks.names import OURS, THINKING
from benchmarks.tasks.paired import paired
from benchmarks.tasks.trial import (
    COLUMNS,
    KEYS,
    OK,
    THINKING_COLUMNS,
    Conditions,
    Task,
    run_tasks,
)
from mdpo_rddl.errors import InputError

_THINKING = "thinking"
_VERDICTS = {1: "better", 0: "as good", -1: "worse"}
_HEADS = (
    *("problem", "instance", "method", "with thinking", "policy alone", "prepared for (s)"),
    *("gained by thinking (95% interval)", "verdict"),
)

Row = Mapping[str, str]


@dataclass
class Shared:
    """What was measured on one task.

    Attributes:
      thinking: rows of the policy that may think, one for each seed.
      alone: rows of the policy alone, after the other preparation; empty where no seed has thought.
      seconds: of the other preparation.
    """

    thinking: list[Row] = field(default_factory=list)
    alone: list[Row] = field(default_factory=list)
    seconds: float = 0.0


def run_sharing(
    out: Path,
    tasks: Sequence[Task],
    seeds: int,
    conditions: Conditions,
    shard: tuple[int, int] = (0, 1),
    decided: int | None = None,
) -> None:
    """Plays with thinking and, where it was chosen, without; rows that are there stay.

    Args:
      out: results folder, with one folder for thinking and one for each other preparation.
      tasks: in the order in which they are tried.
      seeds: of the preparation, from 0.
      conditions: of the trials with thinking.
      shard: (i, n): only every n-th task, from the i-th on.
      decided: episodes whose decisions' time the other preparation has, too; None for all, 0 for a
        preparation that is no longer, but has no choice to make.

    Raises:
      InputError: if the folder has a task's rows with another preparation.
    """
    number, count = shard
    for task in tasks[number::count]:
        rows = run_tasks(out / _THINKING, [task], [THINKING], seeds, conditions).rows
        own = [row for row in rows if _task(row) == task and row["method"]]
        decisions = [_decisions(row, decided) for row in own]
        if not decisions:
            continue
        seconds = conditions.seconds + max(decisions) * conditions.decision_seconds
        known = read_sharing(out).get(task, Shared())
        if known.alone and known.seconds != seconds:
            label = f"{task.problem} {task.instance}".strip()
            raise InputError(f"{out}: {label} has rows of {known.seconds:g} s; use another folder")
        alone = Conditions(seconds, conditions.episodes, conditions.memory_gb)
        run_tasks(out / f"{seconds:g}", [task], [OURS], seeds, alone)


def _decisions(row: Row, episodes: int | None) -> int:
    """Of so many episodes, all of the row's if None, had none ended early."""
    count = len(json.loads(row["returns"])) if episodes is None else episodes
    return count * int(row["horizon"])


def read_sharing(out: Path) -> dict[Task, Shared]:
    """What `run_sharing` has measured so far.

    Raises:
      InputError: if a file holds anything else, or a task has two other preparations.
    """
    found: dict[Task, Shared] = {}
    for row in Records(out / _THINKING / "rows.csv", THINKING_COLUMNS, KEYS).rows:
        found.setdefault(_task(row), Shared()).thinking.append(row)
    for path in sorted(out.glob("*/rows.csv")):
        name = path.parent.name
        if name == _THINKING:
            continue
        try:
            seconds = float(name)
        except ValueError as error:
            raise InputError(f"{path}: its folder is not named by a time in seconds") from error
        for row in Records(path, COLUMNS, KEYS).rows:
            shared = found.setdefault(_task(row), Shared())
            if shared.alone and shared.seconds != seconds:
                label = f"{row['problem']} {row['instance']}"
                raise InputError(f"{path}: {label} has rows of {shared.seconds:g} s as well")
            shared.alone.append(row)
            shared.seconds = seconds
    return found


def sharing_table(measured: Mapping[Task, Shared]) -> str:
    """Markdown: each task with and without thinking, and on how many it has paid."""
    lines = table_head(_HEADS)
    signs = []
    for task, shared in sorted(measured.items(), key=lambda item: str(item[0])):
        names = (task.problem, task.instance)
        methods = "; ".join(
            dict.fromkeys(row["method"] for row in shared.thinking if row["method"])
        )
        if methods and shared.alone:
            cells, sign = paired(shared.thinking, shared.alone)
            signs.append(sign)
            ours, theirs, gain = cells
            seconds = f"{shared.seconds:g}"
            lines.append(table_row((*names, methods, ours, theirs, seconds, gain, _VERDICTS[sign])))
        else:
            lines.append(
                table_row((*names, _not_chosen(shared), _mean(shared.thinking), *[""] * 4))
            )
    counts = ", ".join(f"{_VERDICTS[sign]} on {signs.count(sign)}" for sign in (1, 0, -1))
    lines += ["", f"Thinking was chosen on {len(signs)} of {len(measured)} tasks: {counts}."]
    return "\n".join(lines) + "\n"


def _task(row: Row) -> Task:
    return Task(row["problem"], row["instance"])


def _not_chosen(shared: Shared) -> str:
    """Why no seed has thought."""
    return "; ".join(dict.fromkeys(row["note"] or row["status"] for row in shared.thinking))


def _mean(rows: Sequence[Row]) -> str:
    means = [float(row["mean"]) for row in rows if row["status"] == OK]
    return rounded(sum(means) / len(means), 6) if means else "failed"
