"""A policy of one instance on another one: played untrained, and as the start of a race."""

import functools
import logging
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common.records import Records
from mdpo_rddl.auto import RaceOptions, RaceOutcome, plan_automatically
from mdpo_rddl.auto.resuming.start import START, accepted_start, start_candidates
from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.problem.load import Problem, load_problem

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
    """All columns but the keys; returns are the judge's, on the exact model."""
    given = accepted_start(_race(source, seconds, seed, is_lifted=True).policy, target)
    cold = _race(target, seconds, seed)
    warm = _race(target, seconds, seed, start=given)
    goal = cold.chosen.known_mean
    first = next(j.candidate for j in warm.judged if j.candidate.label == START)
    noop = cold.probe.noop_return if cold.probe else np.nan
    reached = _reached(warm, goal)
    return [
        noop,
        first.known_mean,
        goal,
        _reached(cold, goal),
        warm.chosen.known_mean,
        "" if reached is None else reached,
    ]


def _race(
    problem: Problem,
    seconds: float,
    seed: int,
    start: Policy | None = None,
    is_lifted: bool = False,
) -> RaceOutcome:
    """A race; only for a lifted rule, which fits other instances, if `is_lifted`."""
    config = auto_preset(problem.domain_name).with_values("Optimize", train_seconds=seconds)
    config = config.with_values("Search", optimum_until=0.0)
    if is_lifted:
        config = config.with_values("Search", without=["greedy"])
    options = RaceOptions(initial=functools.partial(start_candidates, policy=start))
    return plan_automatically(problem, config, seed, options)


def _reached(race: RaceOutcome, goal: float) -> float | None:
    """Seconds till the first candidate that returns as much."""
    good = [judged.seconds for judged in race.judged if judged.candidate.known_mean >= goal]
    return round(min(good), 1) if good else None
