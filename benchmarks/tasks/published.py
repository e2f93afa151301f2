"""Tasks with published returns: ours with a minute of preparation, and what others got.

`published.csv` holds 81 tasks with the mean returns of PROST, JaxPlan, GurobiPlan and DiSProD at
1, 3 and 5 s a decision (the experiments of JaxPlan's authors for ICAPS 2024), and of PROST in the
competition of 2014. Ours is played in the episodes of these experiments, in which PROST played all
steps but the last (`published_episodes`).
"""

import csv
import dataclasses
import json
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path

import numpy as np

from benchmarks.common.records import Records
from benchmarks.tasks.names import OURS, THINKING
from benchmarks.tasks.trial import (
    COLUMNS,
    KEYS,
    OK,
    SHORTER,
    THINKING_COLUMNS,
    Conditions,
    Task,
    run_tasks,
)
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.files import MOST_BYTES, decoded, read_bounded

_WITHOUT_THE_LAST_STEP = ("prost_1", "prost_3", "prost_5")
_OF_ALL_STEPS = (
    *("jaxplan_1", "jaxplan_3", "jaxplan_5", "gurobiplan_1", "gurobiplan_3", "gurobiplan_5"),
    *("disprod_1", "disprod_3", "disprod_5", "prost_ippc2014"),
)


def published() -> dict[Task, Mapping[str, str]]:
    """The rows of `published.csv` by their tasks."""
    text = (resources.files(__package__) / "published.csv").read_text(encoding="utf-8")
    rows = csv.DictReader(text.splitlines())
    return {Task(row["problem"], row["instance"]): row for row in rows}


def run_published(
    out: Path,
    problems: Sequence[str] | None,
    seeds: int,
    conditions: Conditions,
    shard: tuple[int, int] = (0, 1),
) -> Records:
    """Prepares and plays on the published tasks; rows that are there already are skipped.

    Args:
      out: results folder.
      problems: names of problems, or "Problem:instance"; all if None.
      seeds: of the preparation.
      conditions: of all trials.
      shard: (i, n): only every n-th task, from the i-th on.

    Raises:
      InputError: for a problem without published returns.
    """
    tasks = only(list(published()), problems)
    number, count = shard
    planner = THINKING if conditions.decision_seconds else OURS
    published_ones = dataclasses.replace(conditions, as_published=True)
    return run_tasks(out, tasks[number::count], [planner], seeds, published_ones)


def only(tasks: Sequence[Task], problems: Sequence[str] | None) -> list[Task]:
    """Those of the tasks that are asked for.

    Args:
      tasks: with published returns.
      problems: names of problems, or "Problem:instance"; all if None.

    Raises:
      InputError: for a name of none of them.
    """
    if problems is None:
        return list(tasks)
    wanted = set(problems)
    chosen = [t for t in tasks if {t.problem, f"{t.problem}:{t.instance}"} & wanted]
    known = {name for t in chosen for name in (t.problem, f"{t.problem}:{t.instance}")}
    if unknown := sorted(wanted - known):
        raise InputError(f"there are no published returns of {unknown[0]!r}")
    return chosen


def read_published(path: Path) -> Records:
    """The rows of `run_published`, with time to think or without.

    Raises:
      InputError: naming the file, if it holds anything else.
    """
    try:
        header = decoded(read_bounded(path, MOST_BYTES)).partition("\n")[0].strip().split(",")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: no such results, which `published` makes") from error
    known = [
        (*columns, *more) for columns in (COLUMNS, THINKING_COLUMNS) for more in ((), (SHORTER,))
    ]
    return Records(path, next((each for each in known if each == tuple(header)), COLUMNS), KEYS)


def score(mean: float, row: Mapping[str, str]) -> float:
    """0 at the better one of no-op and random, 1 at the best published return.

    Where these are the same, 1 for whoever reaches it.
    """
    floor = max(float(row["noop"]), float(row["random"]))
    best = float(row["best"])
    if best - floor <= 1e-9 * max(1.0, abs(best)):
        return float(mean >= best - 1e-6 * max(1.0, abs(best)))
    return (mean - floor) / (best - floor)


def score_in_equal_steps(mean: float, shorter: float, row: Mapping[str, str]) -> float:
    """The score against the best one of PROST's means, or of the others', whichever is lower.

    It is 0 at the no-op's or random return of all steps, against PROST, too.

    Args:
      mean: return.
      shorter: mean return before the last step, which is compared with those of PROST at 1, 3 and
        5 s.
      row: of `published.csv`.
    """
    scores = []
    for ours, columns in ((mean, _OF_ALL_STEPS), (shorter, _WITHOUT_THE_LAST_STEP)):
        if found := [row[name] for name in columns if row[name]]:
            scores.append(score(ours, {**row, "best": max(found, key=float)}))
    return min(scores)


def mean_returns(records: Records) -> dict[Task, float | None]:
    """Of each task that was measured the mean return over its seeds; None if none was played."""
    return _means(records, "mean")


def shorter_returns(records: Records) -> dict[Task, float | None]:
    """The same of what was returned before the last step."""
    return _means(records, SHORTER)


def _means(records: Records, column: str) -> dict[Task, float | None]:
    """Of each task the mean over its seeds of a number, or of a list of them."""
    returns: dict[Task, list[float]] = {}
    for record in records.rows:
        found = returns.setdefault(Task(record["problem"], record["instance"]), [])
        if record["status"] == OK:
            found.append(float(np.mean(json.loads(record[column]))))
    return {task: float(np.mean(found)) if found else None for task, found in returns.items()}
