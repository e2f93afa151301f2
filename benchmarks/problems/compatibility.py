"""Every problem of rddlrepository: where JaxPlan trains, ours must train too."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from benchmarks.common.markdown import escaped
from benchmarks.common.records import Records
from benchmarks.problems.attempts import COLUMNS, KEYS, NOT_PLAYED, PLANNERS, Attempt, try_all
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.guarded import Limits
from mdpo_rddl.machine.versions import versions
from mdpo_rddl.problem.repository import rddl_repository


def run_compatibility(
    out: Path,
    problems: Iterable[str] | None,
    instance: str | None,
    iterations: int,
    max_horizon: int,
    limits: Limits,
) -> Records:
    """Tries each problem with JaxPlan's planner and with ours, as a net and as a plan.

    Every planner has the paper preset with one test rollout; the four of one problem share a
    process. Rows that `out/rows.csv` holds already are skipped.

    Args:
      out: results folder.
      problems: names of rddlrepository; all of it if None.
      instance: its name; the first of each problem if None.
      iterations: training iterations.
      max_horizon: a longer horizon is cut to it.
      limits: for each planner.

    Raises:
      InputError: for an unknown problem.
    """
    names = checked_problems(problems)
    conditions = {"iterations": iterations, "max_horizon": max_horizon, "versions": versions()}
    records = Records(out / "rows.csv", COLUMNS, KEYS, conditions)
    attempts = [
        Attempt(
            name,
            first_instance(name) if instance is None else instance,
            planner,
            iterations,
            episodes=1,
            max_horizon=max_horizon,
            test_batch=1,
        )
        for name in names
        for planner in PLANNERS
    ]
    try_all(records, attempts, limits)
    return records


def checked_problems(problems: Iterable[str] | None) -> list[str]:
    """Names of rddlrepository's problems; all of them if None.

    Raises:
      InputError: for an unknown problem.
    """
    known = sorted(rddl_repository().list_problems())
    names = known if problems is None else list(problems)
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise InputError(f"rddlrepository has no problem {unknown[0]!r}")
    return names


def first_instance(name: str) -> str:
    """The first instance of a problem of rddlrepository."""
    return rddl_repository().get_problem(name).list_instances()[0]


def compatibility_table(records: Records) -> str:
    """Markdown: problems by planners, totals, and the causes of what did not train."""
    cells: dict[tuple[str, str], dict[str, Mapping[str, str]]] = {}
    for row in records.rows:
        cells.setdefault((row["problem"], row["instance"]), {})[row["planner"]] = row
    numbers = _number_causes(records)
    lines = [
        "| problem | instance | horizon | " + " | ".join(PLANNERS) + " |",
        "|" + "---|" * (len(PLANNERS) + 3),
    ]
    for (problem, instance), rows in sorted(cells.items()):
        horizons = [row["horizon"] for row in rows.values() if row["horizon"]]
        results = [_cell(rows.get(planner), numbers) for planner in PLANNERS]
        beginning = [problem, instance, horizons[0] if horizons else ""]
        lines.append("| " + " | ".join(beginning + results) + " |")
    totals = [_total(records, planner) for planner in PLANNERS]
    lines.append("| **ok** | | | " + " | ".join(totals) + " |")
    worse = [
        f"{problem} {instance} ({plan})"
        for (problem, instance), rows in sorted(cells.items())
        for plan in ("drp", "slp")
        if _trains(rows.get(f"jaxplan-{plan}")) and not _trains(rows.get(f"mdpo-{plan}"))
    ]
    lines += ["", f"JaxPlan trains and ours does not: {', '.join(worse) or 'none'}."]
    if numbers:
        lines += ["", "Causes:", ""]
        lines += [f"{number}. {escaped(cause)}" for cause, number in numbers.items()]
    return "\n".join(lines) + "\n"


def _number_causes(records: Records) -> dict[str, int]:
    """The distinct causes, the most frequent first, numbered from 1."""
    counts: dict[str, int] = {}
    for row in records.rows:
        if row["status"] != "ok":
            counts[_cause(row)] = counts.get(_cause(row), 0) + 1
    ordered = sorted(counts, key=lambda cause: (-counts[cause], cause))
    return {cause: number for number, cause in enumerate(ordered, start=1)}


def _cause(row: Mapping[str, str]) -> str:
    return f"{row['status']}: {row['cause']}"


def _cell(row: Mapping[str, str] | None, numbers: Mapping[str, int]) -> str:
    if row is None:
        return ""
    return "ok" if _is_ok(row) else f"{row['status']} ({numbers[_cause(row)]})"


def _is_ok(row: Mapping[str, str] | None) -> bool:
    return row is not None and row["status"] == "ok"


def _trains(row: Mapping[str, str] | None) -> bool:
    return row is not None and row["status"] in ("ok", NOT_PLAYED)


def _total(records: Records, planner: str) -> str:
    rows = [row for row in records.rows if row["planner"] == planner]
    return f"{sum(map(_is_ok, rows))} of {len(rows)}"
