"""Proven optima of problems with few states, checked by episodes of the policies."""

import csv
import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.common.markdown import table_head, table_row
from benchmarks.common.records import Records
from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.machine.files import MOST_BYTES, read_bounded
from mdpo_rddl.machine.guarded import Limits, ProcessFailure, run_guarded
from mdpo_rddl.machine.versions import versions
from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.problem.enumeration.limits import NotEnumerableError
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import load_problem, make_environment
from mdpo_rddl.problem.repository import rddl_repository

logger = logging.getLogger(__name__)

_KIND = "_MDP_"
KEYS = ("problem", "instance")
_FIGURES = ("states", "transitions", "actions", "seconds", "optimum")
_PLAYED = ("mean", "low", "high", "illegal_actions", "misses")
COLUMNS = (*KEYS, "status", "cause", *_FIGURES, *_PLAYED)
_LOADING_SECONDS = 300.0

Published = Mapping[tuple[str, str], float]
"""The best published return of a problem and an instance."""


@dataclass(frozen=True)
class Task:
    """What to solve: names of rddlrepository, and the limits of the solution."""

    problem: str
    instance: str
    seconds: float
    memory_gb: float
    episodes: int


def run_optima(out: Path, tasks: Iterable[Task]) -> Records:
    """Solves each task in a process beside this one and plays the policy.

    Rows that `out/rows.csv` holds already are skipped.
    """
    tasks = list(tasks)
    conditions: dict[str, Any] = {"versions": versions()}
    for task in tasks[:1]:
        conditions |= {
            "seconds": task.seconds,
            "memory_gb": task.memory_gb,
            "episodes": task.episodes,
        }
    records = Records(out / "rows.csv", COLUMNS, KEYS, conditions)
    missing = [task for task in tasks if not records.has(task.problem, task.instance)]
    most = max((task.seconds for task in missing), default=0.0)
    memory = max((task.memory_gb for task in missing), default=0.0)
    for task, outcome in run_guarded(
        run_task, missing, Limits(2 * most + _LOADING_SECONDS, memory)
    ):
        row = _row_of_failure(outcome) if isinstance(outcome, ProcessFailure) else outcome
        values = [row.get(name, "") for name in COLUMNS[len(KEYS) :]]
        records.add(task.problem, task.instance, *values)
        logger.info("%s %s: %s %s", task.problem, task.instance, *values[:2])
    return records


def run_task(task: Task) -> dict[str, Any]:
    """Solves and plays; what stands in the way becomes the status and its one-line cause."""
    row: dict[str, Any] = {"status": "optimum", "cause": ""}
    try:
        problem = load_problem(task.problem, task.instance)
        solution = find_optimum(problem, task.seconds, task.memory_gb)
        row.update({name: getattr(solution.optimum, name) for name in _FIGURES[:3]})
        row.update(seconds=round(solution.optimum.seconds or 0.0, 2), optimum=solution.value)
        policy = solution.policy()
        evaluation = evaluate(make_environment(problem), policy, task.episodes, 0)
        low, high = evaluation.ci95 or ("", "")
        row.update(mean=evaluation.mean, low=low, high=high)
        row.update(illegal_actions=evaluation.illegal_actions, misses=policy.misses)
    except NotEnumerableError as error:
        row.update(status="given up", cause=str(error))
    except Exception as error:  # whatever it is, it is the finding
        row.update(status="error", cause=one_line_cause(error))
    return row


def _row_of_failure(failure: ProcessFailure) -> dict[str, Any]:
    return {"status": failure.status, "cause": failure.cause}


def fully_observed_tasks(
    problems: Iterable[str] | None, instances: Iterable[str]
) -> list[tuple[str, str]]:
    """Problems, by default the fully observed ones of IPPC 2011 and 2014, with instances."""
    known = sorted(rddl_repository().list_problems())
    chosen = [name for name in known if _KIND in name] if problems is None else list(problems)
    unknown = sorted(set(chosen) - set(known))
    if unknown:
        raise InputError(f"rddlrepository has no problem {unknown[0]!r}")
    return [(problem, instance) for problem in chosen for instance in instances]


def read_published(path: Path) -> dict[tuple[str, str], float]:
    """The best published returns: a CSV file with columns problem, instance and best.

    Raises:
      InputError: if it is missing or has other columns.
    """
    try:
        text = read_bounded(path, MOST_BYTES).decode()
        rows = list(csv.DictReader(text.splitlines()))
        return {(row["problem"], row["instance"]): float(row["best"]) for row in rows}
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: is no file of published returns: {error}") from error


def optima_table(records: Records, published: Published | None = None) -> str:
    """Markdown: each task with its optimum, the episodes and the best published return."""
    heads = ["problem", "instance", "states", "actions", "seconds", "optimum", "episodes (95%)"]
    heads += ["best published"] if published else []
    lines = table_head(heads)
    for row in sorted(records.rows, key=lambda row: (row["problem"], row["instance"])):
        cells = [row["problem"], row["instance"], *_cells(row)]
        if published:
            best = published.get((row["problem"], row["instance"]))
            cells.append("" if best is None else f"{best:g}")
        lines.append(table_row(cells))
    solved = sum(row["status"] == "optimum" for row in records.rows)
    lines += ["", f"Proven optimum: {solved} of {len(records.rows)}."]
    inside = [row for row in records.rows if row["low"] and _is_inside(row)]
    lines += [f"The optimum lies in the episodes' 95% interval: {len(inside)} of {solved}."]
    return "\n".join(lines) + "\n"


def _cells(row: Mapping[str, str]) -> list[str]:
    if row["status"] != "optimum":
        return ["", "", "", f"{row['status']}: {row['cause']}", ""]
    interval = f"{float(row['mean']):.4g}"
    if row["low"]:
        interval += f" ({float(row['low']):.4g} to {float(row['high']):.4g})"
    states, actions = int(row["states"]), int(row["actions"])
    return [f"{states:,}", f"{actions}", row["seconds"], f"{float(row['optimum']):.6g}", interval]


def _is_inside(row: Mapping[str, str]) -> bool:
    # all episodes may be equal where the policy avoids what is random
    rounding = 1e-6 * (1 + abs(float(row["optimum"])))
    low, high = float(row["low"]) - rounding, float(row["high"]) + rounding
    return low <= float(row["optimum"]) <= high
