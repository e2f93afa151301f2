"""Tasks with published returns: ours with a minute of preparation, and what others got.

`published.csv` holds 81 tasks with the mean returns of PROST, JaxPlan, GurobiPlan and DiSProD at
1, 3 and 5 s a decision (the experiments of JaxPlan's authors for ICAPS 2024), and of PROST in the
competition of 2014.
"""

import csv
import dataclasses
import json
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path

import numpy as np

from mdpo_rddl.bench.common.markdown import rounded, table_row
from mdpo_rddl.bench.common.records import Records
from mdpo_rddl.bench.tasks.names import OURS, THINKING
from mdpo_rddl.bench.tasks.paired import common_returns, paired_returns
from mdpo_rddl.bench.tasks.trial import (
    ALONE,
    COLUMNS,
    KEYS,
    OK,
    THINKING_COLUMNS,
    Conditions,
    Task,
    run_tasks,
)
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.files import MOST_BYTES, decoded, read_bounded
from mdpo_rddl.problem.evaluation import mean_interval

AT_THE_BEST = 0.99
_SIGNS = {"better": 1, "as good": 0, "worse": -1}
OTHERS = {
    "PROST 1 s": "prost_1",
    "JaxPlan 1 s": "jaxplan_1",
    "GurobiPlan 1 s": "gurobiplan_1",
    "DiSProD 1 s": "disprod_1",
}


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
    # a mean is compared with another one, of other episodes
    whole = dataclasses.replace(conditions, plays_all=True)
    return run_tasks(out, tasks[number::count], [planner], seeds, whole)


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
        header = decoded(read_bounded(path, MOST_BYTES)).partition("\n")[0].split(",")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: no such results; mdpo-bench published makes them") from error
    is_thinking = tuple(header) == THINKING_COLUMNS
    return Records(path, THINKING_COLUMNS if is_thinking else COLUMNS, KEYS)


def score(mean: float, row: Mapping[str, str]) -> float:
    """0 at the better one of no-op and random, 1 at the best published return.

    Where these are the same, 1 for whoever reaches it.
    """
    floor = max(float(row["noop"]), float(row["random"]))
    best = float(row["best"])
    if best - floor <= 1e-9 * max(1.0, abs(best)):
        return float(mean >= best - 1e-6 * max(1.0, abs(best)))
    return (mean - floor) / (best - floor)


def mean_returns(records: Records) -> dict[Task, float | None]:
    """Of each task that was measured the mean return over its seeds; None if none was played."""
    returns: dict[Task, list[float]] = {}
    for record in records.rows:
        found = returns.setdefault(Task(record["problem"], record["instance"]), [])
        if record["status"] == OK:
            found.append(float(record["mean"]))
    return {task: float(np.mean(found)) if found else None for task, found in returns.items()}


def published_table(records: Records) -> str:
    """Markdown: each task's mean return and score beside the others', and the totals."""
    rows, measured = published(), mean_returns(records)
    failed = {
        Task(record["problem"], record["instance"]): record["status"]
        for record in records.rows
        if record["status"] != OK
    }
    lines = [
        "| problem | instance | ours | score | best published | by | "
        + " | ".join(OTHERS)
        + " | no-op | random |",
        "|" + "---|" * (len(OTHERS) + 8),
    ]
    scores = []
    for task, row in rows.items():
        if task not in measured:
            continue
        ours = measured[task]
        scores.append(0.0 if ours is None else score(ours, row))
        shown = failed[task] if ours is None else rounded(ours, 6)
        cells = [task.problem, task.instance, shown, f"{scores[-1]:.3f}", _number(row["best"])]
        cells += [row["best_by"], *(_number(row[name]) for name in OTHERS.values())]
        cells += [_number(row["noop"]), _number(row["random"])]
        lines.append(table_row(cells))
    said = [totals(np.array(scores)), *_certainly_below(records), *_thinking(records)]
    lines += ["", " ".join(said)]
    return "\n".join(lines) + "\n"


def _number(text: str) -> str:
    return rounded(float(text), 6) if text else ""


def _certainly_below(records: Records) -> list[str]:
    """On how many tasks the episodes are enough to tell that ours is below the best."""
    measured = mean_returns(records)
    below = 0
    for task, row in published().items():
        if task not in measured:
            continue
        place = task.problem, task.instance, OK
        keys = "problem", "instance", "status"
        played = [each for each in records.rows if tuple(each[key] for key in keys) == place]
        returns = common_returns(played) if played else None
        interval = (-np.inf, -np.inf) if returns is None else mean_interval(returns)
        below += interval is not None and score(interval[1], row) < AT_THE_BEST
    if not measured:
        return []
    return [f"Below {AT_THE_BEST:g} with all of the 95% interval of its episodes: {below}."]


def _thinking(records: Records) -> list[str]:
    """How long decisions were, and where trials had chosen to use that; nothing without time."""
    times = {row["decision_seconds"] for row in records.rows if row.get("decision_seconds")}
    if not times:
        return []
    chosen = [row for row in records.rows if row["method"]]
    tasks = {Task(row["problem"], row["instance"]) for row in chosen}
    said = f"Ours with {', '.join(sorted(times))} s a decision, used on {len(tasks)} tasks."
    signs = [
        paired_returns(np.array(json.loads(row["returns"])), np.array(json.loads(row[ALONE]))).sign
        for row in chosen
        if row[ALONE]
    ]
    if not signs:
        return [said]
    counts = ", ".join(f"{name} on {signs.count(sign)}" for name, sign in _SIGNS.items())
    return [said, f"Against the same policy alone in the same episodes: {counts}."]


def totals(scores: np.ndarray, best: str = "the best published return") -> str:
    """How many tasks reach the best, and the mean score.

    Args:
      scores: of the tasks, as `score` gives them.
      best: what a score of 1 stands for.
    """
    if not scores.size:
        return "No task has been played."
    reached = int(np.sum(scores >= AT_THE_BEST))
    mean = float(np.mean(np.minimum(scores, 1.0)))
    return (
        f"At {AT_THE_BEST:g} of {best} or above: {reached} of {len(scores)}. "
        f"Mean score, each at most 1: {mean:.3f}. Below 0: {int(np.sum(scores < 0.0))}."
    )
