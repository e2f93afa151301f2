"""The preset `auto` against the experts and JaxPlan's defaults, on the same episodes."""

import json
import logging
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np
from scipy import stats

from benchmarks.common.auto_variants import VARIANTS
from benchmarks.common.names import SETTINGS
from benchmarks.common.records import Records
from benchmarks.common.settings import load_setting
from benchmarks.presets.experts import expert
from benchmarks.presets.names import EARLIER, PLANNERS
from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.baseline import train_baseline
from mdpo_rddl.planner.build import build_baseline
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.jaxplan_configs import jaxplan_config
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.evaluation import Policy, evaluate, mean_interval
from mdpo_rddl.problem.load import Problem, load_problem, make_environment
from mdpo_rddl.race.budget import Budget as RaceBudget
from mdpo_rddl.race.race import race

logger = logging.getLogger(__name__)

COLUMNS = (
    "problem",
    "planner",
    "seed",
    "mean_return",
    "last_return",
    "seconds",
    "chosen",
    "returns",
)
KEYS = COLUMNS[:3]
# of the episodes, far from any training seed
_EVALUATION_SEED = 2023


def run_auto(
    out: Path,
    problems: Iterable[str],
    planners: Iterable[str],
    seeds: int,
    seconds: float,
    episodes: int,
) -> Records:
    """Trains and plays; rows that `out/runs.csv` holds already are skipped.

    Args:
      out: results folder.
      problems: names of settings, or "Problem:instance" of rddlrepository.
      planners: of `PLANNERS`; the expert needs no seed and plays once.
      seeds: training seeds of each planner.
      seconds: of each training; with `auto` and its variants compilation counts, with JaxPlan
        it does not.
      episodes: on the exact environment, the same for all planners.
    """
    conditions = {"seconds": seconds, "episodes": episodes}
    records = Records(out / "runs.csv", COLUMNS, KEYS, conditions)
    wanted = list(planners)
    for name in problems:
        problem = _load(name)
        for seed in range(seeds):
            for planner in wanted:
                if (planner == "expert" and seed) or records.has(name, planner, seed):
                    continue
                row = _try(problem, planner, seed, seconds, episodes)
                records.add(name, planner, seed, *row)
                logger.info("%s, %s, seed %d: %.2f", name, planner, seed, row[0])
    return records


def _load(name: str) -> Problem:
    if name in SETTINGS:
        return load_setting(name)
    domain, colon, instance = name.partition(":")
    if not colon:
        raise InputError(f"unknown problem {name!r}: a setting or Problem:instance")
    return load_problem(domain, instance)


def _try(
    problem: Problem, planner: str, seed: int, seconds: float, episodes: int
) -> tuple[Any, ...]:
    def play(policy: Policy) -> np.ndarray:
        return evaluate(make_environment(problem), policy, episodes, _EVALUATION_SEED).returns

    started = time.perf_counter()
    if planner == "expert":
        policy, chosen = expert(problem), ""
    elif planner in VARIANTS:
        config = VARIANTS[planner](auto_preset(problem.domain_name))
        outcome = race(problem, config, RaceBudget.of(seconds), seed)
        policy, chosen = outcome.policy, outcome.chosen.label
    else:
        method = planner.split("-")[1]
        built = build_baseline(problem, jaxplan_config("default", method))
        trained = train_baseline(built, jax.random.PRNGKey(seed), Budget(10**6, seconds))
        hyperparams = trained.policy_hyperparams
        policy, chosen = playable(trained.planner, trained.params, hyperparams, seed), ""
    trained_for = round(time.perf_counter() - started, 1)
    returns = play(policy)
    text = json.dumps([round(value, 4) for value in returns.tolist()])
    last = ""  # a race has no last iterate; the column is that of earlier results
    return float(returns.mean()), last, trained_for, chosen, text


def auto_table(records: Records) -> str:
    """Markdown: means, and ours minus each other planner's, episode by episode."""
    lines = [
        "| problem | planner | seeds | mean return | worst seed | median seed | "
        "auto's lead (95% interval) | auto leads | over the seeds (95% interval) |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for problem in dict.fromkeys(row["problem"] for row in records.rows):
        ours = _by_seed(records, problem, "auto")
        for planner in (*PLANNERS, EARLIER):
            theirs = _by_seed(records, problem, planner)
            if not theirs.size:
                continue
            means = theirs.mean(axis=1)
            cells = [problem, planner, str(len(means)), f"{means.mean():,.2f}"]
            cells += [f"{means.min():,.2f}", f"{np.median(means):,.2f}"]
            is_compared = planner != "auto" and ours.size
            cells += [*_lead(ours, theirs), _over_seeds(ours, theirs)] if is_compared else [""] * 3
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _by_seed(records: Records, problem: str, planner: str) -> np.ndarray:
    """Returns per seed and episode [S, E]."""
    rows = [json.loads(row["returns"]) for row in records.rows if _is(row, problem, planner)]
    return np.array(rows)


def _is(row: Mapping[str, str], problem: str, planner: str) -> bool:
    return (row["problem"], row["planner"]) == (problem, planner)


def _over_seeds(ours: np.ndarray, theirs: np.ndarray) -> str:
    """Welch's interval of the difference, each seed's mean once; empty for one seed."""
    if min(len(ours), len(theirs)) < 2:
        return ""
    ours, theirs = ours.mean(axis=1), theirs.mean(axis=1)
    found = stats.ttest_ind(ours, theirs, equal_var=False).confidence_interval()
    return f"{ours.mean() - theirs.mean():,.2f} [{found.low:,.2f}, {found.high:,.2f}]"


def _lead(ours: np.ndarray, theirs: np.ndarray) -> list[str]:
    """Student's interval over the episodes, of means over the seeds: the same rain for both."""
    lead = ours.mean(axis=0) - theirs.mean(axis=0)
    mean = float(lead.mean())
    low, high = mean_interval(lead) or (mean, mean)
    verdict = "yes" if low > 0 else "no" if high < 0 else "as good"
    return [f"{mean:,.2f} [{low:,.2f}, {high:,.2f}]", verdict]
