"""Instances of the competition of 2014: ours beside PROST, the winner of its MDP track.

`ippc2014.csv` holds the returns of PROST there, means of thirty episodes each, on the forty
instances with even numbers; those with odd ones are among the tasks of `published.csv`.
"""

import csv
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path

import numpy as np

from benchmarks.common.markdown import rounded, table_head, table_row
from benchmarks.common.records import Records
from benchmarks.tasks.everywhere import by_task
from benchmarks.tasks.names import NOOP, OURS, RANDOM, THINKING
from benchmarks.tasks.published import only, score
from benchmarks.tasks.published_table import against_alone, totals
from benchmarks.tasks.trial import OK, Conditions, Task, run_tasks
from mdpo_rddl.race.arms.ground import DYNAMIC_PROGRAMMING

_HEADS = "problem", "instance", "ours", "optimum", "score", "PROST", "no-op", "random"
_BEST = "PROST's return"


def competition() -> dict[Task, float]:
    """What PROST returned in the competition, by task."""
    text = (resources.files(__package__) / "ippc2014.csv").read_text(encoding="utf-8")
    rows = csv.DictReader(text.splitlines())
    return {Task(row["problem"], row["instance"]): float(row["prost"]) for row in rows}


def run_ippc2014(
    out: Path,
    problems: Sequence[str] | None,
    seeds: int,
    conditions: Conditions,
    shard: tuple[int, int] = (0, 1),
) -> Records:
    """Prepares and plays on the instances; rows that are there already are skipped.

    Args:
      out: results folder.
      problems: names of problems, or "Problem:instance"; all if None.
      seeds: of the preparation.
      conditions: of all trials.
      shard: (i, n): only every n-th task, from the i-th on.

    Raises:
      InputError: for a problem that is not among them.
    """
    number, count = shard
    tasks = only(list(competition()), problems)
    ours = THINKING if conditions.decision_seconds else OURS
    return run_tasks(out, tasks[number::count], (ours, NOOP, RANDOM), seeds, conditions)


def ippc2014_table(records: Records) -> str:
    """Markdown: each instance's mean return and score beside PROST's return, and the totals.

    Where the optimum is proven, what the score lacks is chance: thirty episodes are few. With time
    at the decisions the table says as well on how many instances ours has used it, and gained.
    """
    lines = table_head(_HEADS)
    scores, is_proven, measured = list[float](), list[bool](), by_task(records)
    for task, prost in competition().items():
        rows = measured.get((task.problem, task.instance), {})
        ours = rows.get(THINKING) or rows.get(OURS)
        if ours is None or not {NOOP, RANDOM} <= rows.keys():
            continue
        noop, random = rows[NOOP], rows[RANDOM]
        against = {"noop": _mean(noop), "random": _mean(random), "best": str(prost)}
        scores.append(score(float(ours["mean"]), against) if ours["status"] == OK else 0.0)
        is_proven.append(ours["arms"] == DYNAMIC_PROGRAMMING)
        cells = [task.problem, task.instance, _shown(ours), "proven" if is_proven[-1] else ""]
        cells += [f"{scores[-1]:.3f}", rounded(prost, 6), _shown(noop), _shown(random)]
        lines.append(table_row(cells))
    others = np.array(scores)[~np.array(is_proven, bool)]
    lines += ["", totals(np.array(scores), _BEST)]
    if len(others) < len(scores):
        lines += ["", f"Without the proven optima. {totals(others, _BEST)}"]
    if said := against_alone(records):
        lines += ["", " ".join(said)]
    return "\n".join(lines) + "\n"


def _mean(row: Mapping[str, str]) -> str:
    return row["mean"] if row["status"] == OK else "-inf"


def _shown(row: Mapping[str, str]) -> str:
    return rounded(float(row["mean"]), 6) if row["status"] == OK else row["status"]
