"""Every problem of rddlrepository: does the compiled exact model obey the environment's rules?"""

import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.common.markdown import escaped
from benchmarks.common.records import Records
from benchmarks.problems.agreement import compare, steps_per_second
from benchmarks.problems.compatibility import checked_problems, first_instance
from benchmarks.problems.each import KEYS, add_rows
from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.machine.guarded import Limits
from mdpo_rddl.machine.memory import peak_mb
from mdpo_rddl.machine.versions import versions
from mdpo_rddl.problem.load import load_problem

_FIGURES = ("horizon", "chance", "illegal", "steps", "steps_per_second", "seconds", "peak_mb")
_COLUMNS = ("status", "cause", *_FIGURES)


class Item(NamedTuple):
    """One problem to compare on.

    Attributes:
      problem, instance: names of rddlrepository.
      max_horizon: a longer horizon is cut to it.
    """

    problem: str
    instance: str
    max_horizon: int


def run_exactness(
    out: Path, problems: Iterable[str] | None, max_horizon: int, limits: Limits
) -> Records:
    """Compares on the first instance of each problem, each in a process of its own.

    Rows that `out/rows.csv` holds already are skipped.

    Args:
      out: results folder.
      problems: names of rddlrepository; all of it if None.
      max_horizon: a longer horizon is cut to it.
      limits: for each problem.

    Raises:
      InputError: for an unknown problem.
    """
    conditions = {"max_horizon": max_horizon, "versions": versions()}
    records = Records(out / "rows.csv", (*KEYS, *_COLUMNS), KEYS, conditions)
    items = [Item(name, first_instance(name), max_horizon) for name in checked_problems(problems)]
    return add_rows(records, _COLUMNS, items, check, limits)


def check(item: Item) -> dict[str, Any]:
    """Compares on one problem; an error becomes the status and its one-line cause."""
    started = time.perf_counter()
    row: dict[str, Any] = {"status": "ok", "cause": ""}
    try:
        problem = load_problem(item.problem, item.instance)
        if problem.horizon > item.max_horizon:
            problem = load_problem(item.problem, item.instance, item.max_horizon)
        row["horizon"] = problem.horizon
        row["steps_per_second"] = round(steps_per_second(problem))
        found = compare(problem)
        row.update(chance=found.chance, illegal=found.illegal, steps=found.steps)
        if found.difference:
            row.update(status="differs", cause=found.difference)
        elif found.illegal:
            row.update(status="illegal", cause="the environment refused a legalised action")
    except Exception as error:  # whatever it is, it is the finding
        row.update(status="error", cause=one_line_cause(error))
    row["seconds"] = round(time.perf_counter() - started, 1)
    row["peak_mb"] = round(peak_mb())
    return row


def exactness_table(records: Records) -> str:
    """Markdown: per problem the finding, what was illegal, and the speed."""
    good = sum(row["status"] == "ok" for row in records.rows)
    lines = [
        f"The compiled model and the environment agree on {good} of {len(records.rows)} problems.",
        "",
        "| problem | instance | horizon | chance | result | illegal | million steps a CPU second |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in sorted(records.rows, key=lambda row: row["problem"]):
        result = row["status"] + (f": {row['cause']}" if row["cause"] else "")
        speed = row["steps_per_second"] and f"{float(row['steps_per_second']) / 1e6:.3f}"
        cells = [row["problem"], row["instance"], row["horizon"], row["chance"]]
        illegal = f"{row['illegal']} of {row['steps']}" if row["steps"] else ""
        cells += [escaped(result), illegal, speed]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
