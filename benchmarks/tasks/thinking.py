"""What thinking at the decisions adds to the policy that was prepared, in the same episodes."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.common.markdown import rounded, table_head, table_row
from benchmarks.common.records import Records
from benchmarks.tasks.names import THINKING
from benchmarks.tasks.paired import paired_returns
from benchmarks.tasks.trial import ALONE, OK, Conditions, Task, run_tasks

_VERDICTS = {1: "above", 0: "as good", -1: "below"}
_HEADS = (
    *("problem", "instance", "method", "with thinking", "policy alone"),
    *("gained (95% interval)", "verdict", "decisions", "left the policy", "99% within (s)"),
    "longest (s)",
)


def run_thinking(
    out: Path,
    tasks: Sequence[Task],
    seeds: int,
    conditions: Conditions,
    shard: tuple[int, int] = (0, 1),
) -> Records:
    """Prepares and plays with time to think; rows that are there stay.

    Args:
      out: results folder.
      tasks: in the order in which they are tried.
      seeds: of the preparation, from 0.
      conditions: of all trials.
      shard: (i, n): only every n-th task, from the i-th on.
    """
    number, count = shard
    return run_tasks(out, tasks[number::count], [THINKING], seeds, conditions)


def thinking_table(records: Records) -> str:
    """Markdown: each run with thinking and without, and on how many it was above."""
    lines = table_head(_HEADS)
    signs = []
    for row in sorted(records.rows, key=lambda each: (each["problem"], each["instance"])):
        names = row["problem"], row["instance"]
        if not (row["status"] == OK and row[ALONE]):
            why = row["note"] or row["status"]
            mean = rounded(float(row["mean"]), 6) if row["status"] == OK else "failed"
            lines.append(table_row((*names, why, mean, *[""] * (len(_HEADS) - 4))))
            continue
        with_thinking, alone = (np.array(json.loads(row[each])) for each in ("returns", ALONE))
        cells, sign = paired_returns(with_thinking, alone)
        signs.append(sign)
        lines.append(table_row((*names, row["method"], *cells, _VERDICTS[sign], *_decisions(row))))
    counts = ", ".join(f"{_VERDICTS[sign]} on {signs.count(sign)}" for sign in (1, 0, -1))
    lines += ["", f"Thinking was chosen in {len(signs)} of {len(records.rows)} runs: {counts}."]
    return "\n".join(lines) + "\n"


def _decisions(row: Mapping[str, str]) -> list[str]:
    """Their number, how many left the policy's action, and how long they took."""
    counts = [f"{float(row[each]):,.0f}" for each in ("decisions", "left_base")]
    return [*counts, *(f"{float(row[each]):.3f}" for each in ("p99_seconds", "max_seconds"))]
