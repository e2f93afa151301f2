"""Which configuration suits which IPC 2023 domain, against JaxPlan's own in the same time.

The configurations that the project ships are what `choose` makes of the rows.
"""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import jax
import numpy as np

from benchmarks.common.markdown import escaped
from benchmarks.common.records import Records
from benchmarks.configs.candidates import MANY, candidates
from benchmarks.configs.choice import BASELINE, NOOP, REFERENCES, choose
from benchmarks.configs.names import PLANS
from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.machine.files import write_atomically
from mdpo_rddl.machine.guarded import Limits, ProcessFailure, run_guarded
from mdpo_rddl.machine.versions import versions
from mdpo_rddl.planner.baseline import train_baseline
from mdpo_rddl.planner.build import build_baseline, build_planner
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.jaxplan_configs import jaxplan_config
from mdpo_rddl.planner.training.training import train
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.evaluation import Evaluation, evaluate
from mdpo_rddl.problem.load import Problem, load_problem, make_environment

logger = logging.getLogger(__name__)

CHOSEN = "chosen"
KEYS = ("domain", "instance", "plan", "candidate")
COLUMNS = (*KEYS, "status", "return", "error", "iterations", "illegal")


@dataclass(frozen=True)
class Run:
    """One training and its evaluation.

    Attributes:
      domain, instance, plan: the problem, as in the records.
      candidate: a name out of `candidates` or of `REFERENCES`.
      seconds: of training, compilation not counted.
      episodes: on the exact environment.
    """

    domain: str
    instance: str
    plan: str
    candidate: str
    seconds: float
    episodes: int


@dataclass(frozen=True)
class Grid:
    """What is tried on what.

    Attributes:
      domains: keys of `SCALES`.
      instances: names of instances.
      plans: out of `PLANS`.
      names: of the candidates; all if None. `CHOSEN` is the one that the rows so far speak for.
    """

    domains: Sequence[str]
    instances: Sequence[str]
    plans: Sequence[str] = PLANS
    names: Sequence[str] | None = None


def run_config_sweep(
    out: Path, grid: Grid, seconds: float, episodes: int, limits: Limits
) -> Records:
    """Trains and plays every candidate and JaxPlan's own planner, one after the other.

    Rows that `out/runs.csv` holds already are skipped.

    Args:
      out: results folder.
      grid: what is tried on what.
      seconds: of training for each.
      episodes: evaluation episodes; each planner plays the same.
      limits: for each run.

    Raises:
      InputError: for an unknown candidate.
    """
    known = candidates("HVAC", "drp")
    for name in grid.names or ():
        if name not in (CHOSEN, *known):
            raise InputError(f"unknown candidate {name!r}, known are {', '.join(known)}")
    conditions = {"seconds": seconds, "episodes": episodes, "versions": versions()}
    records = Records(out / "runs.csv", COLUMNS, KEYS, conditions)
    for domain in grid.domains:
        for plan in grid.plans:
            chosen = choose(records.rows, domain, plan)
            wanted = [chosen if name == CHOSEN else name for name in grid.names or known]
            tried = [name for name in candidates(domain, plan) if name in wanted]
            runs = [
                Run(domain, instance, plan, candidate, seconds, episodes)
                for instance in grid.instances
                for candidate in [*REFERENCES, *tried]
                if not records.has(domain, instance, plan, candidate)
            ]
            _run(records, runs, limits)
    return records


def _run(records: Records, runs: Sequence[Run], limits: Limits) -> None:
    for _, group in groupby(runs, key=lambda run: (run.domain, run.instance, run.plan)):
        for run, outcome in run_guarded(train_and_play, list(group), limits):
            row = {"status": outcome.cause} if isinstance(outcome, ProcessFailure) else outcome
            key = (run.domain, run.instance, run.plan, run.candidate)
            records.add(*key, *(row.get(name, "") for name in COLUMNS[len(KEYS) :]))
            logger.info("%s: %s %s", " ".join(key), row["status"], row.get("return", ""))


def train_and_play(run: Run) -> dict[str, Any]:
    """The row of one run; an error becomes its status."""
    try:
        evaluation, iterations = _train_and_play(run)
    except Exception as error:  # whatever it is, it is the finding
        return {"status": one_line_cause(error)}
    spread = evaluation.std / math.sqrt(len(evaluation.returns))
    return {
        "status": "ok" if np.isfinite(evaluation.mean) else "non-finite",
        "return": evaluation.mean,
        "error": spread,
        "iterations": iterations,
        "illegal": evaluation.illegal_actions,
    }


def _train_and_play(run: Run) -> tuple[Evaluation, int]:
    problem = load_problem(f"{run.domain}_ippc2023", run.instance)
    if run.candidate == NOOP:
        return evaluate(make_environment(problem), lambda step, state: {}, run.episodes, 0), 0
    key, budget = jax.random.PRNGKey(0), Budget(MANY, run.seconds)
    if run.candidate == BASELINE:
        own = jaxplan_config(f"{run.domain}_ippc2023", run.plan)
        trained = train_baseline(build_baseline(problem, own), key, budget)
        return _play(problem, run, *trained[:3]), trained.iterations
    built = build_planner(problem, candidates(run.domain, run.plan)[run.candidate])
    result = train(built, key, budget)
    evaluation = _play(problem, run, built.planner, result.best_params, result.policy_hyperparams)
    return evaluation, result.iterations


def _play(problem: Problem, run: Run, planner: Any, params: Any, hyperparams: Any) -> Evaluation:
    policy = playable(planner, params, hyperparams, 0)
    return evaluate(make_environment(problem), policy, run.episodes, 0)


def config_sweep_table(records: Records) -> str:
    """Markdown: per problem and plan the return of every candidate, the chosen one in bold."""
    names = [*REFERENCES, *candidates("HVAC", "drp")]
    lines = [
        "| problem | instance | plan | " + " | ".join(names) + " |",
        "|" + "---|" * (len(names) + 3),
    ]
    problems = sorted({(row["domain"], row["plan"], row["instance"]) for row in records.rows})
    for domain, plan, instance in problems:
        chosen = choose(records.rows, domain, plan)
        found = {
            row["candidate"]: row
            for row in records.rows
            if (row["domain"], row["plan"], row["instance"]) == (domain, plan, instance)
        }
        cells = [_cell(found.get(name), bold=name == chosen) for name in names]
        lines.append("| " + " | ".join([f"{domain}_ippc2023", instance, plan, *cells]) + " |")
    return "\n".join(lines) + "\n"


def _cell(row: Mapping[str, str] | None, bold: bool) -> str:
    if row is None:
        return ""
    if row["status"] != "ok":
        return escaped(row["status"])
    mean, error = float(row["return"]), float(row["error"])
    digits = 0 if abs(mean) >= 1000 else 3
    text = f"{mean:,.{digits}f} ± {error:,.{digits}f}"
    return f"**{text}**" if bold else text


def shipped_text(rows: Sequence[Mapping[str, str]], domain: str, plan: str) -> str:
    """The file that the project ships for a domain and plan: the chosen candidate's."""
    chosen = choose(rows, domain, plan)
    return f"# {chosen}: see results/configs\n{candidates(domain, plan)[chosen].to_text()}"


def ship(records: Records, folder: Path) -> None:
    """Writes the chosen configuration of every domain and plan that the records know."""
    for domain, plan in sorted({(row["domain"], row["plan"]) for row in records.rows}):
        path = folder / f"{domain}_ippc2023_{plan}.cfg"
        write_atomically(path, shipped_text(records.rows, domain, plan))
