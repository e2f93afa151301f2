"""Replan at every decision, from the state that the exact environment shows."""

import csv
from pathlib import Path
from typing import Any

import jax
import numpy as np

from mdpo_rddl.machine.logs import kept_warnings
from mdpo_rddl.machine.versions import package_versions
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.budgets import DECISION_SECONDS, Budget
from mdpo_rddl.policy.replanning import Decision, OnlinePolicy
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.session.evaluator import Evaluator
from mdpo_rddl.session.observed import Observed
from mdpo_rddl.session.report.page.write import add_page
from mdpo_rddl.session.report.run_folder import SUMMARY, RunFolder, write_json
from mdpo_rddl.session.report.summary import identity, planner_figures, return_figures
from mdpo_rddl.session.requests import PlanRequest, Reporter


def replan(request: PlanRequest, reporter: Reporter) -> dict[str, Any]:
    """Plays the exact environment by replanning at every decision, and writes the run folder.

    The budget of a decision is `train_seconds` and `epochs` of `[Optimize]`; compilation is
    done before the first one and counts in none.

    Returns:
      The summary, as `summary.json` holds it.

    Raises:
      InputError: as `plan` does.
    """
    with RunFolder(request.out) as folder, kept_warnings() as warnings:
        reporter.stage("compiling")
        built = build_planner(request.problem, request.config)
        planner, budget = built.planner, request.config.budget(seconds=DECISION_SECONDS)
        # JaxPlan divides by epochs - 1
        budget = Budget(max(2, budget.iterations), budget.seconds)
        policy = OnlinePolicy(built, request.seed, budget)
        state = make_environment(request.problem).reset(seed=request.seed)[0]
        compile_seconds = policy.compile(state)
        reporter.stage("replanning")
        observed = Observed(request)
        found = Evaluator(request, reporter).run(policy, observed)
        seconds = [decision.seconds for decision in policy.decisions]
        summary = {
            **identity(
                request.problem,
                planner_figures(request.config, planner),
                config_name=request.config_name,
                seed=request.seed,
                episodes=request.episodes,
            ),
            **return_figures(found),
            "mode": "replan",
            "lookahead": planner.horizon,
            "decision_seconds": budget.seconds,
            "decision_iterations": budget.iterations,
            "decisions": len(policy.decisions),
            "mean_iterations": float(np.mean([d.iterations for d in policy.decisions])),
            "mean_seconds": float(np.mean(seconds)),
            "max_seconds": float(np.max(seconds)),
            "restarts": planner.restarts,
            "batch": planner.batch_size_train,
            "compile_seconds": compile_seconds,
            "device": str(jax.devices()[0]),
            "versions": package_versions(),
            **observed.figures(),
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
        add_page(folder)
        folder.commit()
    return summary


def _write_decisions(path: Path, decisions: list[Decision]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(Decision._fields)
        writer.writerows(decisions)
