"""Which configuration suits which IPC 2023 domain, against JaxPlan's own in the same time.

The configurations that the project ships are what `choose` makes of the rows.
"""

import logging
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import jax
import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.evaluation import Evaluation, evaluate
from mdpo_rddl.experiments.jaxplan_baseline import train_baseline
from mdpo_rddl.experiments.records import Records
from mdpo_rddl.experiments.trial import one_line_cause
from mdpo_rddl.experiments.versions import versions
from mdpo_rddl.experiments.worker import Death, Limits, run_guarded
from mdpo_rddl.jaxplan.config import PlannerConfig
from mdpo_rddl.jaxplan.own_configs import own_config
from mdpo_rddl.planning import build_planner, playable
from mdpo_rddl.problem import Problem, load_problem, make_environment
from mdpo_rddl.training import train

logger = logging.getLogger(__name__)

BASELINE = "JaxPlan 3.1"
CHOSEN = "chosen"
PLANS = ("drp", "slp")
KEYS = ("domain", "instance", "plan", "candidate")
COLUMNS = (*KEYS, "status", "return", "error", "iterations", "illegal")

# what counts as a strong noise, in units of the domain's actions (RecSim: of its logits)
SCALES = {
    "HVAC": 10.0,
    "MarsRover": 1.0,
    "MountainCar": 1.0,
    "PowerGen": 10.0,
    "RaceCar": 1.0,
    "RecSim": 1.0,
    "Reservoir": 10.0,
    "UAV": 1.0,
}
_SHIPPED_SECONDS = 60
_MANY = 1_000_000
_LEVEL = 0.02


def candidates(domain: str, plan: str) -> dict[str, PlannerConfig]:
    """The configurations that are tried, by name.

    All start from JaxPlan's own for the domain, or its default; none counts rewards after
    termination.

    Args:
      domain: a key of `SCALES`.
      plan: one of `PLANS`.
    """
    own = own_config(f"{domain}_ippc2023", plan)
    budget = {"epochs": _MANY, "train_seconds": _SHIPPED_SECONDS}
    base = own.with_values("Optimize", **budget).with_section("MDPO", {"stop_at_termination": True})
    still = base.with_section("Noise", {"method": "NoNoise"})

    def noisy(share: float, faster: float = 1.0, batch: int | None = None) -> PlannerConfig:
        noise = {"method": "AdaptiveNoise", "sigma_max": share * SCALES[domain]}
        config = base.with_values("Planner", pgpe=None).with_section("Noise", noise)
        optimizer = dict(base.section("Planner")["optimizer_kwargs"])
        optimizer["learning_rate"] = faster * optimizer["learning_rate"]
        config = config.with_values("Planner", optimizer_kwargs=optimizer)
        if batch is not None:
            sizes = {"batch_size_train": batch, "batch_size_test": batch}
            config = config.with_values("Planner", **sizes)
        return config

    def in_calls(config: PlannerConfig) -> PlannerConfig:
        # a test after every tenth iteration can be a better one
        config = config.with_values("Planner", batch_size_test=16)
        config = config.with_values("Optimize", test_rolling_window=5)
        return config.with_values("MDPO", iterations_per_call=50, test_every=10)

    def with_net(config: PlannerConfig, **arguments: Any) -> PlannerConfig:
        arguments = {**config.section("Planner")["method_kwargs"], **arguments}
        return config.with_values("Planner", method_kwargs=arguments)

    found = {
        "jaxplan": still,
        "no-pgpe": still.with_values("Planner", pgpe=None),
        "low": noisy(0.1),
        "high": noisy(1.0),
        "low-fast": noisy(0.1, faster=10.0),
        "low-fast-batch4": noisy(0.1, faster=10.0, batch=4),
        "pgpe-low": base.with_section("Noise", noisy(0.1).section("Noise")),
        "normalised": still.with_values("Planner", preprocessor="StaticNormalizer"),
        "calls-low-fast": in_calls(noisy(0.1, faster=10.0, batch=4)),
        "calls-high-fast": in_calls(noisy(1.0, faster=10.0, batch=4)),
        "calls-low": in_calls(noisy(0.1, faster=3.0, batch=4)),
    }
    if plan == "drp":
        found["calls-normed"] = with_net(found["calls-low-fast"], normalize=True)
        faster = in_calls(noisy(0.1, faster=30.0, batch=4))
        found["calls-squashed"] = with_net(faster, normalize=True, wrap_non_bool=True)
    return found


@dataclass(frozen=True)
class Run:
    """One training and its evaluation.

    Attributes:
      domain, instance, plan: the problem, as in the records.
      candidate: a name out of `candidates`, or `BASELINE`.
      seconds: of training, compilation not counted.
      episodes: on the exact environment.
    """

    domain: str
    instance: str
    plan: str
    candidate: str
    seconds: float
    episodes: int


def run_config_sweep(
    out: Path,
    domains: Iterable[str],
    instances: Iterable[str],
    names: Sequence[str] | None,
    seconds: float,
    episodes: int,
    limits: Limits,
    plans: Iterable[str] = PLANS,
) -> Records:
    """Trains and plays every candidate and JaxPlan's own planner, one after the other.

    Rows that `out/runs.csv` holds already are skipped.

    Args:
      out: results folder.
      domains: keys of `SCALES`.
      instances: names of instances.
      names: of the candidates; all if None. `CHOSEN` is the one that the rows so far speak for.
      seconds: of training for each.
      episodes: evaluation episodes; each planner plays the same.
      limits: for each run.
      plans: out of `PLANS`.

    Raises:
      InputError: for an unknown candidate.
    """
    known = candidates("HVAC", "drp")
    for name in names or ():
        if name not in (CHOSEN, *known):
            raise InputError(f"unknown candidate {name!r}, known are {', '.join(known)}")
    conditions = {"seconds": seconds, "episodes": episodes, "versions": versions()}
    records = Records(out / "runs.csv", COLUMNS, KEYS, conditions)
    instances, plans = list(instances), list(plans)
    for domain in domains:
        for plan in plans:
            chosen = choose(records.rows, domain, plan)
            wanted = [chosen if name == CHOSEN else name for name in names or known]
            tried = [name for name in candidates(domain, plan) if name in wanted]
            runs = [
                Run(domain, instance, plan, candidate, seconds, episodes)
                for instance in instances
                for candidate in [BASELINE, *tried]
                if not records.has(domain, instance, plan, candidate)
            ]
            _run(records, runs, limits)
    return records


def _run(records: Records, runs: Sequence[Run], limits: Limits) -> None:
    for _, group in groupby(runs, key=lambda run: (run.domain, run.instance, run.plan)):
        for run, outcome in run_guarded(train_and_play, list(group), limits):
            row = {"status": outcome.cause} if isinstance(outcome, Death) else outcome
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
    if run.candidate == BASELINE:
        own = own_config(f"{run.domain}_ippc2023", run.plan)
        trained = train_baseline(problem, own, 0, _MANY, run.seconds)
        return _play(problem, run, *trained[:3]), trained.iterations
    planner, arguments = build_planner(problem, candidates(run.domain, run.plan)[run.candidate])
    for name in ("key", "epochs", "train_seconds"):
        arguments.pop(name, None)
    result = train(
        planner,
        key=jax.random.PRNGKey(0),
        iterations=_MANY,
        seconds=run.seconds,
        optimize_kwargs=arguments,
    )
    evaluation = _play(problem, run, planner, result.best_params, result.policy_hyperparams)
    return evaluation, result.iterations


def _play(problem: Problem, run: Run, planner: Any, params: Any, hyperparams: Any) -> Evaluation:
    policy = playable(planner, params, hyperparams, 0)
    return evaluate(make_environment(problem), policy, run.episodes, 0)


def choose(rows: Iterable[Mapping[str, str]], domain: str, plan: str) -> str:
    """The candidate that the rows speak for.

    On each instance a candidate earns (return - baseline) / (best - worst) over all that was
    tried there. Fit are those that were tried on most instances and lost by more than one
    standard error of the difference on none. Of these the largest mean wins, or one level with
    it (within 0.02) that needs fewer rollouts an iteration, so that larger instances fit into
    memory; "jaxplan" if none is fit.

    Args:
      rows: with `COLUMNS`.
      domain, plan: which of them.
    """
    own = [row for row in rows if row["domain"] == domain and row["plan"] == plan]
    earned: dict[str, list[float]] = {}
    worse: set[str] = set()
    for _, group in groupby(
        sorted(own, key=lambda row: row["instance"]), key=lambda row: row["instance"]
    ):
        tried = {row["candidate"]: row for row in group}
        means = {name: _number(row, "return") for name, row in tried.items()}
        known = [mean for mean in means.values() if math.isfinite(mean)]
        reference = means.get(BASELINE, -math.inf)
        spread = (max(known) - min(known)) if known else 0.0
        for name, mean in means.items():
            if not math.isfinite(mean):
                worse.add(name)
                continue
            floor = reference if math.isfinite(reference) else min(known)
            earned.setdefault(name, []).append((mean - floor) / spread if spread else 0.0)
            error = math.hypot(*(_number(tried.get(n), "error") for n in (name, BASELINE)))
            if math.isfinite(reference) and mean < reference - error:
                worse.add(name)
    earned.pop(BASELINE, None)
    most = max(map(len, earned.values()), default=0)
    fit = {n: float(np.mean(e)) for n, e in earned.items() if len(e) == most and n not in worse}
    best = max(fit.values(), default=0.0)
    level = [name for name in fit if fit[name] >= best - _LEVEL]
    configs = candidates(domain, plan)
    batch = {name: configs[name].section("Planner")["batch_size_train"] for name in level}
    return min(level, key=lambda name: (batch[name], -fit[name]), default="jaxplan")


def _number(row: Mapping[str, str] | None, column: str) -> float:
    if row is None or not row[column]:
        return 0.0 if column == "error" else -math.inf
    return float(row[column])


def config_sweep_table(records: Records) -> str:
    """Markdown: per problem and plan the return of every candidate, the chosen one in bold."""
    names = [BASELINE, *candidates("HVAC", "drp")]
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
        return row["status"].replace("|", "\\|")
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
        path.write_text(shipped_text(records.rows, domain, plan), encoding="utf-8")
