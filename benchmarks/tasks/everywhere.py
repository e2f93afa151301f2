"""Every domain of rddlrepository: ours against JaxPlan, the no-op policy and random actions."""

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.common.markdown import rounded
from benchmarks.common.records import Records
from benchmarks.tasks.names import OURS, PLANNERS
from benchmarks.tasks.naming import named_task
from benchmarks.tasks.trial import OK, Conditions, run_tasks
from mdpo_rddl.problem.evaluation import mean_interval
from mdpo_rddl.problem.repository import rddl_repository


def domains() -> list[str]:
    """The names of all problems of rddlrepository."""
    return sorted(rddl_repository().list_problems())


def run_everywhere(
    out: Path,
    problems: Sequence[str] | None,
    planners: Iterable[str],
    seeds: int,
    conditions: Conditions,
    shard: tuple[int, int] = (0, 1),
) -> Records:
    """Tries an instance of each problem; rows that are there already are skipped.

    Args:
      out: results folder.
      problems: as `named_task` takes them; all of rddlrepository if None.
      planners: out of `PLANNERS`.
      seeds: of the preparation.
      conditions: of all trials.
      shard: (i, n): only every n-th problem, from the i-th on.

    Raises:
      InputError: for an unknown problem, instance or file.
    """
    names = domains() if problems is None else problems
    tasks = [*map(named_task, names)]
    number, count = shard
    return run_tasks(out, tasks[number::count], planners, seeds, conditions)


def everywhere_table(records: Records) -> str:
    """Markdown: mean returns, whether ours is below any of the others, and which arms found it."""
    others = [name for name in PLANNERS if name != OURS]
    lines = [
        "| problem | instance | " + " | ".join(PLANNERS) + " | ours is below |",
        "|" + "---|" * (len(PLANNERS) + 3),
    ]
    below, compared = 0, 0
    for (problem, instance), rows in by_task(records).items():
        cells = [_cell(rows.get(name)) for name in PLANNERS]
        ours = rows.get(OURS)
        losses = [] if ours is None else [n for n in others if _is_below(ours, rows.get(n))]
        compared += ours is not None
        below += bool(losses)
        lines.append(
            f"| {problem} | {instance} | " + " | ".join(cells) + f" | {', '.join(losses)} |"
        )
    lines += ["", f"Below another planner: {below} of {compared} problems."]
    if found_by := _found_by(records):
        lines += ["", f"Ours were found by: {found_by}."]
    return "\n".join(lines) + "\n"


def by_task(records: Records) -> dict[tuple[str, str], dict[str, Mapping[str, str]]]:
    """Per task and planner the row of the first seed."""
    tasks: dict[tuple[str, str], dict[str, Mapping[str, str]]] = {}
    for row in records.rows:
        if row["seed"] == "0":
            tasks.setdefault((row["problem"], row["instance"]), {})[row["planner"]] = row
    return dict(sorted(tasks.items()))


def _found_by(records: Records) -> str:
    """How many policies each arm has found, the most first."""
    arms = [row["arms"].split("; ")[-1] for row in records.rows if row["arms"]]
    return ", ".join(f"{name} {count}" for name, count in Counter(arms).most_common())


def _cell(row: Mapping[str, str] | None) -> str:
    if row is None:
        return ""
    return rounded(float(row["mean"]), 6) if row["status"] == OK else row["status"]


def _is_below(ours: Mapping[str, str], theirs: Mapping[str, str] | None) -> bool:
    """Whether the 95% interval of the paired difference of the episodes' returns is below 0.

    A planner without returns is below one that has some.
    """
    if theirs is None or theirs["status"] != OK:
        return False
    if ours["status"] != OK:
        return True
    difference = np.subtract(json.loads(ours["returns"]), json.loads(theirs["returns"]))
    _, high = mean_interval(difference) or (difference.mean(), difference.mean())
    # returns of the two are rounded alike
    slack = 1e-6 * max(1.0, float(np.max(np.abs(json.loads(theirs["returns"])))))
    return bool(high < -slack)
