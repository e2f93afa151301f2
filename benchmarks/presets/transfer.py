"""A policy of one instance on another one: played untrained, and as the start of a race."""

import logging
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from benchmarks.common.records import Records
from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.problem.load import Problem, load_problem
from mdpo_rddl.race.budget import Budget
from mdpo_rddl.race.outcome import Outcome
from mdpo_rddl.race.race import GIVEN, RaceOptions, race
from mdpo_rddl.session.race import accepted, start_from

logger = logging.getLogger(__name__)

COLUMNS = (
    "problem",
    "source",
    "target",
    "noop",
    "untrained",
    "cold",
    "cold_seconds",
    "warm",
    "warm_seconds",
)
KEYS = COLUMNS[:3]


def run_transfer(out: Path, pairs: Iterable[str], seconds: float, seed: int) -> Records:
    """Three races for each pair; rows that `out/transfer.csv` holds already are skipped.

    Args:
      out: results folder.
      pairs: "Problem:i:j" of rddlrepository: the policy of instance i is carried to j.
      seconds: of each race, compilation included.
      seed: of all of them.
    """
    conditions = {"seconds": seconds, "seed": seed}
    records = Records(out / "transfer.csv", COLUMNS, KEYS, conditions)
    for pair in pairs:
        name, _, instances = pair.partition(":")
        source, _, target = instances.partition(":")
        if not target:
            raise InputError(f"{pair}: must be Problem:instance:instance")
        if not records.has(name, source, target):
            row = _row(load_problem(name, source), load_problem(name, target), seconds, seed)
            records.add(name, source, target, *row)
            logger.info("%s: %s", pair, row)
    return records


def transfer_table(records: Records) -> str:
    """The rows as a Markdown table."""
    lines = [
        "| problem | policy of | played on | no-op | untrained | cold start | reached by cold "
        "start after | by the given policy after |",
        "|---|---|---|---:|---:|---:|---:|---:|",
    ]
    for row in records.rows:
        numbers = (f"{float(row[key]):,.0f}" for key in ("noop", "untrained", "cold"))
        times = (_seconds(row[key]) for key in ("cold_seconds", "warm_seconds"))
        cells = (row["problem"], row["source"], row["target"], *numbers, *times)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _seconds(text: str) -> str:
    return f"{float(text):.0f} s" if text else "not reached"


def _row(source: Problem, target: Problem, seconds: float, seed: int) -> list[Any]:
    """All columns but the keys; returns are the evaluator's, on the exact model."""
    given = accepted(_race(source, seconds, seed, is_lifted=True).policy, target)
    cold = _race(target, seconds, seed)
    warm = _race(target, seconds, seed, start=given)
    goal = max(point.mean for point in cold.points)
    first = next(point for point in warm.points if point.candidate.label == GIVEN)
    reached = _reached(warm, goal)
    return [
        cold.noop_return,
        first.mean,
        goal,
        _reached(cold, goal),
        max(point.mean for point in warm.points),
        "" if reached is None else reached,
    ]


def _race(
    problem: Problem,
    seconds: float,
    seed: int,
    start: Policy | None = None,
    is_lifted: bool = False,
) -> Outcome:
    """A race; only for a lifted rule, which fits other instances, if `is_lifted`."""
    without = ["dynamic programming", *(["greedy", "relaxed plans"] if is_lifted else [])]
    config = auto_preset(problem.domain_name).with_values("Search", without=without)
    options = RaceOptions(initial=start_from(start, problem))
    return race(problem, config, Budget.of(seconds), seed, options)


def _reached(outcome: Outcome, goal: float) -> float | None:
    """Seconds till the first candidate that returns as much."""
    good = [point.seconds for point in outcome.points if point.mean >= goal]
    return round(min(good), 1) if good else None
