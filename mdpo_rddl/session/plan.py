"""Train a policy once, then evaluate it."""

import contextlib
import dataclasses
import logging
from typing import TYPE_CHECKING, Any

import jax

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.search_section import read_search
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.training import Progress, TrainingResult, train
from mdpo_rddl.planner.upstream import JaxStraightLinePlan
from mdpo_rddl.policy.file import SavedPolicy, problem_identity
from mdpo_rddl.session.evaluator import Evaluator
from mdpo_rddl.session.preparation import preparing
from mdpo_rddl.session.report.run_folder import SUMMARY, RunFolder, write_json, write_training
from mdpo_rddl.session.report.summary import identity, return_figures, title, training_figures
from mdpo_rddl.session.requests import PlanRequest, Reporter
from mdpo_rddl.session.second_evaluator import SecondEvaluator

if TYPE_CHECKING:
    from mdpo_rddl.auto import AutoResult

logger = logging.getLogger(__name__)


def plan(request: PlanRequest, reporter: Reporter) -> dict[str, Any]:
    """Trains a policy, evaluates it exactly and writes the run folder.

    Returns:
      The summary, as `summary.json` holds it.

    Raises:
      InputError: if the problem, the configuration or the folder cannot be used; nothing
        is left behind then.
    """
    auto = read_search(request.config.sections) is not None
    with RunFolder(request.out) as folder, contextlib.ExitStack() as stack:
        found: dict[str, Any] = {}
        second = None
        if auto:
            chosen = _plan_automatically(request, reporter)
            planner, result, found = chosen.planner, chosen.training, {"auto": chosen.diagnostics}
            request = dataclasses.replace(request, config=chosen.config)
        else:
            second = stack.enter_context(SecondEvaluator(request))
            planner, result = _train(request, reporter)
        saved = SavedPolicy(
            params=result.best_params,
            policy_hyperparams=dict(result.policy_hyperparams),
            config=request.config.to_text(),
            problem=problem_identity(request.problem),
            seed=request.seed,
        )
        reporter.stage("evaluating")
        evaluator = Evaluator(request, planner, result.policy_hyperparams, reporter)
        if second is not None:
            second.begin(result.best_params, result.policy_hyperparams)
        last = evaluator.run(result.last_params)
        best = (second and second.result()) or evaluator.run(result.best_params)
        summary = {
            **identity(request, planner),
            **return_figures(best),
            "last_iterate": return_figures(last),
            **training_figures(planner, result),
            **found,
        }
        config = {
            "source": request.config_name,
            "sections": request.config.sections,
            "seed": request.seed,
            "episodes": request.episodes,
        }
        with folder.writing():
            write_training(folder.staging, result, saved, config, title(summary))
            write_json(folder.staging / SUMMARY, summary)
        folder.commit()
    return summary


def _train(request: PlanRequest, reporter: Reporter) -> tuple[MDPOPlanner, TrainingResult]:
    """One training as the configuration has it."""
    reporter.stage("compiling")
    built = build_planner(request.problem, request.config, request.programs)
    planner = built.planner
    steps, horizon = planner.horizon, request.problem.horizon
    if isinstance(planner.plan, JaxStraightLinePlan) and steps < horizon:
        message = "the plan has %d steps, its last action is repeated up to the horizon %d"
        logger.warning(message, steps, horizon)
    try:
        with preparing(planner, request) as begin_preparing:

            def on_progress(progress: Progress) -> None:
                begin_preparing()
                reporter.training(progress)

            result = train(built, jax.random.PRNGKey(request.seed), on_progress=on_progress)
    except InputError as error:
        raise InputError(
            f"{request.problem.instance_path}: {error} (configured by {request.config.source})"
        ) from error
    return planner, result


def _plan_automatically(request: PlanRequest, reporter: Reporter) -> "AutoResult":
    # the search's package takes long to import, which other presets need not wait for
    from mdpo_rddl.auto import plan_automatically

    return plan_automatically(
        request.problem,
        request.config,
        seed=request.seed,
        programs=request.programs,
        on_stage=reporter.stage,
        on_progress=reporter.training,
    )
