"""One problem tried with one planner: does it compile, train and play without an error?"""

import logging
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import jax
import numpy as np

from benchmarks.common.full_training import train_fully
from benchmarks.common.records import Records
from benchmarks.problems.missing import missing_package
from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.machine.guarded import Limits, ProcessFailure, run_guarded
from mdpo_rddl.machine.memory import peak_mb
from mdpo_rddl.planner.baseline import train_baseline
from mdpo_rddl.planner.build import build_baseline, build_planner
from mdpo_rddl.planner.config.budgets import A_DAY, Budget
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import Problem, load_problem, make_environment

logger = logging.getLogger(__name__)

PLANNERS = ("jaxplan-drp", "jaxplan-slp", "mdpo-drp", "mdpo-slp")
KEYS = ("problem", "instance", "planner")
NOT_PLAYED = "not played"
_FIGURES = ("horizon", "return", "illegal_actions", "fallback_actions")
COLUMNS = (*KEYS, "status", "cause", *_FIGURES, "seconds", "peak_mb")

_PLANS: dict[str, dict[str, Any]] = {
    "drp": {},
    "slp": {"method": "JaxStraightLinePlan", "method_kwargs": {}},
}


@dataclass(frozen=True)
class Attempt:
    """What to try.

    Attributes:
      problem, instance: names of rddlrepository, or two files.
      planner: one of `PLANNERS`.
      iterations: of training.
      episodes: played on the exact environment with all its checks on; by ours only.
      max_horizon: a longer horizon is cut to it.
      test_batch: test rollouts an iteration; the preset's if None.
    """

    problem: str
    instance: str
    planner: str
    iterations: int
    episodes: int
    max_horizon: int | None = None
    test_batch: int | None = None


def try_all(
    records: Records, attempts: Iterable[Attempt], limits: Limits, work: Any = None
) -> None:
    """Runs the attempts that the records lack, those of one problem in one process.

    Args:
      records: with `COLUMNS` and `KEYS`; a row is added as soon as an attempt has ended.
      attempts: in the order of their problems.
      limits: for each attempt.
      work: what to run in the process; `run_attempt` if None.
    """
    missing = [a for a in attempts if not records.has(a.problem, a.instance, a.planner)]
    for _, group in groupby(missing, key=lambda a: (a.problem, a.instance)):
        for attempt, outcome in run_guarded(work or run_attempt, list(group), limits):
            row = _row_of_failure(outcome) if isinstance(outcome, ProcessFailure) else outcome
            values = [row.get(name, "") for name in COLUMNS[len(KEYS) :]]
            records.add(attempt.problem, attempt.instance, attempt.planner, *values)
            label = f"{attempt.problem} {attempt.instance}, {attempt.planner}"
            logger.info("%s: %s %s", label, row["status"], row["cause"])


def run_attempt(attempt: Attempt) -> dict[str, Any]:
    """Compiles, trains and plays; an error becomes the status and its one-line cause."""
    started = time.perf_counter()
    row: dict[str, Any] = {"status": "ok", "cause": ""}
    try:
        _try(attempt, row)
    except _PlayError as error:
        row.update(status=NOT_PLAYED, cause=one_line_cause(error))
    except _NonFiniteError as error:
        row.update(status="non-finite", cause=str(error))
    except Exception as error:  # whatever it is, it is the finding
        row.update(status="error", cause=missing_package(error) or one_line_cause(error))
    row["seconds"] = round(time.perf_counter() - started, 1)
    row["peak_mb"] = round(peak_mb())
    return row


class _PlayError(Exception):
    """The exact environment failed or refused an action, after a training without an error."""


class _NonFiniteError(Exception):
    """A return that is not a number."""


def _row_of_failure(failure: ProcessFailure) -> dict[str, Any]:
    seconds, peak = round(failure.seconds, 1), round(failure.peak_mb)
    return {"status": failure.status, "cause": failure.cause, "seconds": seconds, "peak_mb": peak}


def _try(attempt: Attempt, row: dict[str, Any]) -> None:
    problem = load_problem(attempt.problem, attempt.instance)
    if attempt.max_horizon is not None and problem.horizon > attempt.max_horizon:
        problem = load_problem(attempt.problem, attempt.instance, attempt.max_horizon)
    row["horizon"] = problem.horizon
    library, plan = attempt.planner.split("-")
    config = PRESETS["paper"](problem.domain_name)
    if _PLANS[plan]:
        config = config.with_values("Planner", **_PLANS[plan])
    if attempt.test_batch is not None:
        config = config.with_values("Planner", batch_size_test=attempt.test_batch)
    if library == "jaxplan":
        _train_jaxplan(problem, config, attempt.iterations)
    else:
        row.update(_train_and_play(problem, config, attempt))


def _train_jaxplan(problem: Problem, config: PlannerConfig, iterations: int) -> None:
    def require_finite(callback: Mapping[str, Any]) -> None:
        _require_finite("training", [callback["train_return"]])
        _require_finite("test", [callback["test_return"]])

    train_baseline(
        build_baseline(problem, config),
        jax.random.PRNGKey(0),
        Budget(iterations, A_DAY),
        counts_compilation=True,
        on_iteration=require_finite,
    )


def _train_and_play(problem: Problem, config: PlannerConfig, attempt: Attempt) -> dict[str, Any]:
    built = build_planner(problem, config)
    result = train_fully(built, jax.random.PRNGKey(0), attempt.iterations)
    _require_finite("training", [record.train_return for record in result.history])
    _require_finite("test", [record.test_return for record in result.history])
    policy = playable(built.planner, result.best_params, result.policy_hyperparams, 0)
    env = make_environment(problem, enforce_action_constraints=True)
    try:
        evaluation = evaluate(env, policy, attempt.episodes, 0)
    except Exception as error:  # whatever it is, the planner has trained
        raise _PlayError(str(error) or type(error).__name__) from error
    _require_finite("exact", evaluation.returns)
    return {
        "return": evaluation.mean,
        "illegal_actions": evaluation.illegal_actions,
        "fallback_actions": evaluation.fallback_actions,
    }


def _require_finite(name: str, returns: Sequence[Any] | np.ndarray) -> None:
    for value in np.ravel(np.asarray(returns, float)):
        if not np.isfinite(value):
            raise _NonFiniteError(f"{name} return {value}")
