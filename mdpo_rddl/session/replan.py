"""Replan at every decision, from the state that the exact environment shows."""

import csv
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.errors import InputError, note_heard, one_line_cause
from mdpo_rddl.machine.device import current_device
from mdpo_rddl.machine.files import finite_or_none
from mdpo_rddl.machine.logs import kept_warnings
from mdpo_rddl.machine.versions import package_versions
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.budgets import DECISION_SECONDS
from mdpo_rddl.policy.replanning import Decision, OnlinePolicy
from mdpo_rddl.problem.enumeration.model import require_legal_start
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.session.evaluator import Evaluator
from mdpo_rddl.session.observed import Observed, warn_of
from mdpo_rddl.session.report.page.write import add_page
from mdpo_rddl.session.report.run_folder import SUMMARY, RunFolder, write_json
from mdpo_rddl.session.report.summary import (
    identity,
    not_played_figures,
    planner_figures,
    return_figures,
    warn_of_unplayable,
)
from mdpo_rddl.session.requests import PlanRequest, Reporter

logger = logging.getLogger(__name__)


class _End(NamedTuple):
    """How playing ended before its time.

    Attributes:
      status: "failed" or "interrupted".
      cause: in words.
    """

    status: str
    cause: str


def replan(request: PlanRequest, reporter: Reporter) -> dict[str, Any]:
    """Plays the exact environment by replanning at every decision, and writes the run folder.

    The budget of a decision is `train_seconds` and `epochs` of `[Optimize]`; compilation is
    done before the first one and counts in none. Where it is stopped, or a decision or the
    environment fails, the run folder has what was planned and played until then.

    Returns:
      The summary, as `summary.json` holds it.

    Raises:
      InputError: as `plan` does, and if a decision fails.
      KeyboardInterrupt: if interrupted before the first decision.
    """
    if request.problem.model.observ_fluents:
        path = request.problem.instance_path
        raise InputError(f"{path}: --replan plans from the state, which is observed in part only")
    with RunFolder(request.out) as folder, kept_warnings() as warnings:
        warn_of(request.problem)
        require_legal_start(request.problem)
        reporter.stage("compiling")
        built = build_planner(request.problem, request.config)
        planner, budget = built.planner, request.config.budget(seconds=DECISION_SECONDS)
        policy = OnlinePolicy(built, request.seed, budget)
        state = make_environment(request.problem).reset(seed=request.seed)[0]
        try:
            compile_seconds = policy.compile(state)
        except InputError:
            raise
        except Exception as error:  # whatever the problem and the values make JAX raise
            cause = f"{type(error).__name__}: {one_line_cause(error)}"
            path = request.problem.instance_path
            raise InputError(f"{path}: decisions cannot be compiled: {cause}") from error
        reporter.stage("replanning")
        observed, evaluator = Observed(request), Evaluator(request, reporter)
        end = _played(evaluator, policy, observed)
        figures = _returns(evaluator, end)
        summary = {
            **identity(
                request.problem,
                planner_figures(request.config),
                config_name=request.config_name,
                seed=request.seed,
                episodes=request.episodes if end is None else evaluator.ended,
            ),
            **figures,
            "mode": "replan",
            "lookahead": planner.horizon,
            "decision_seconds": budget.seconds,
            "decision_iterations": budget.iterations,
            "decisions": len(policy.decisions),
            **_decision_figures(policy.decisions),
            "restarts": planner.restarts,
            "batch": planner.batch_size_train,
            "compile_seconds": compile_seconds,
            "device": str(current_device()),
            "versions": package_versions(),
            **(observed.figures(figures["returns"]) if end is None else {}),
            "warnings": warnings,
            "command": request.command,
        }
        config = {
            "source": request.config_name,
            "sections": request.config.sections,
            "seed": request.seed,
            "episodes": request.episodes,
        }
        with folder.writing():
            _write_decisions(folder.staging / "decisions.csv", policy.decisions)
            write_json(folder.staging / "config.json", config)
            write_json(folder.staging / SUMMARY, summary)
            observed.write(folder.staging)
        if evaluator.ended:
            add_page(folder)
        folder.commit()
    if end is not None and end.status == "failed":
        raise InputError(f"{end.cause}; what was planned until then is in {folder.target}")
    return summary


def _decision_figures(decisions: Sequence[Decision]) -> dict[str, float | None]:
    """How long they took; None for all where the episodes ended before any."""
    names = "mean_iterations", "mean_seconds", "max_seconds"
    if not decisions:
        return dict.fromkeys(names)
    iterations = np.mean([decision.iterations for decision in decisions])
    seconds = np.array([decision.seconds for decision in decisions])
    figures = map(float, (iterations, seconds.mean(), seconds.max()))
    return dict(zip(names, figures, strict=True))


def _played(evaluator: Evaluator, policy: OnlinePolicy, observed: Observed) -> _End | None:
    """Plays the episodes; how that ended before its time, once there was a decision."""
    try:
        evaluator.run(policy, observed)
    except KeyboardInterrupt as stop:
        if not policy.decisions:
            raise
        note_heard(stop)
        return _End("interrupted", "interrupted")
    except Exception as error:  # the environment's, or whatever planning makes of a state
        logger.debug("replanning has failed", exc_info=True)
        cause = _told(error, evaluator)
        if not policy.decisions:
            raise InputError(cause) from error
        return _End("failed", cause)
    return None


def _told(error: Exception, evaluator: Evaluator) -> str:
    if isinstance(error, InputError):
        return str(error)
    step = sum(episode.steps for episode in evaluator.begun[evaluator.ended :])
    cause = f"{type(error).__name__}: {one_line_cause(error)}"
    return f"{evaluator.place}, step {step}: cannot be planned: {cause}"


def _returns(evaluator: Evaluator, end: _End | None) -> dict[str, Any]:
    """The figures of the returns, with how playing ended before its time."""
    found = evaluator.so_far()
    warn_of_unplayable(found)
    if end is None:
        return return_figures(found)
    figures = return_figures(found) if evaluator.ended else not_played_figures(end.cause)
    for last in evaluator.begun[evaluator.ended :]:
        figures["illegal_actions"] += last.illegal
        figures["fallback_actions"] += last.fallback
        total = finite_or_none(last.total)
        figures["unfinished_episode"] = {"steps": last.steps, "return": total}
    return {**figures, "status": end.status, "cause": end.cause}


def _write_decisions(path: Path, decisions: list[Decision]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(Decision._fields)
        writer.writerows(decisions)
