"""The eight IPC 2023 domains: all compile, train briefly and play without an illegal action."""

from collections.abc import Iterable
from pathlib import Path

from benchmarks.common.markdown import escaped
from benchmarks.common.records import Records
from benchmarks.problems.attempts import COLUMNS, KEYS, Attempt, try_all
from mdpo_rddl.machine.guarded import Limits
from mdpo_rddl.machine.versions import versions

PLANNERS = ("mdpo-drp", "mdpo-slp")
# the test rollouts of an iteration take most of the time there: two instead of 20
_TEST_BATCH = {("RecSim", "5"): 2}


def run_ipc_smoke(
    out: Path,
    domains: Iterable[str],
    instances: Iterable[str],
    iterations: int,
    episodes: int,
    limits: Limits,
) -> Records:
    """Trains and plays each instance with the paper preset, each in a process of its own.

    Runs that `out/runs.csv` holds already are skipped.

    Args:
      out: results folder.
      domains: names out of `DOMAINS`.
      instances: names of instances.
      iterations: training iterations.
      episodes: evaluation episodes, with every check of the environment on.
      limits: for each run.
    """
    conditions = {"iterations": iterations, "episodes": episodes, "versions": versions()}
    records = Records(out / "runs.csv", COLUMNS, KEYS, conditions)
    instances = list(instances)
    for domain in domains:
        for instance in instances:
            for planner in PLANNERS:
                attempt = Attempt(
                    f"{domain}_ippc2023",
                    instance,
                    planner,
                    iterations,
                    episodes,
                    test_batch=_TEST_BATCH.get((domain, instance)),
                )
                try_all(records, [attempt], limits)
    return records


def ipc_smoke_table(records: Records) -> str:
    """Markdown: per instance and policy the return, what was illegal, and the costs."""
    ok = [row for row in records.rows if row["status"] == "ok"]
    lines = [
        f"{len(ok)} of {len(records.rows)} runs without an error.",
        "",
        "| problem | instance | planner | status | return | illegal | fallback | s | MB |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in sorted(records.rows, key=lambda row: [row[key] for key in KEYS]):
        mean = f"{float(row['return']):,.2f}" if row["return"] else ""
        status = row["status"] if row["status"] == "ok" else f"{row['status']}: {row['cause']}"
        cells = [
            *(row[key] for key in KEYS),
            escaped(status),
            mean,
            row["illegal_actions"],
            row["fallback_actions"],
            f"{float(row['seconds']):.0f}",
            f"{float(row['peak_mb']):.0f}",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
