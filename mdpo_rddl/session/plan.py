"""Find a policy once, by one training or by the race of the preset `auto`, then evaluate it."""

import contextlib
import logging
from typing import TYPE_CHECKING, Any

import jax

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.search_section import read_search
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.training import Progress, TrainingResult, train
from mdpo_rddl.planner.upstream import JaxStraightLinePlan
from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.problem.evaluation import Evaluation
from mdpo_rddl.session.evaluator import Evaluator
from mdpo_rddl.session.preparation import preparing
from mdpo_rddl.session.report.race import race_figures, write_race
from mdpo_rddl.session.report.run_folder import RunFolder, write_summary
from mdpo_rddl.session.report.summary import (
    identity,
    policy_figures,
    return_figures,
    training_figures,
)
from mdpo_rddl.session.report.training import write_training
from mdpo_rddl.session.requests import PlanRequest, Reporter
from mdpo_rddl.session.second_evaluator import SecondEvaluator
from mdpo_rddl.session.thinking import think

if TYPE_CHECKING:
    from mdpo_rddl.auto import RaceOutcome

logger = logging.getLogger(__name__)


def plan(request: PlanRequest, reporter: Reporter) -> dict[str, Any]:
    """Finds a policy, evaluates it exactly and writes the run folder.

    Returns:
      The summary, as `summary.json` holds it.

    Raises:
      InputError: if the problem, the configuration or the folder cannot be used; nothing
        is left behind then.
    """
    with RunFolder(request.out) as folder:
        is_race = read_search(request.config.sections) is not None
        return (_race if is_race else _train_once)(request, reporter, folder)


def _train_once(request: PlanRequest, reporter: Reporter, folder: RunFolder) -> dict[str, Any]:
    with contextlib.ExitStack() as stack:
        second = stack.enter_context(SecondEvaluator(request))
        planner, result = _train(request, reporter)
        hyperparams, seed = dict(result.policy_hyperparams), request.seed
        policy = Policy(
            request.problem, request.config, planner, result.best_params, hyperparams, seed
        )
        reporter.stage("evaluating")
        evaluator = Evaluator(request, reporter)
        second.begin(policy.params, hyperparams)
        last = evaluator.run(policy.with_params(result.last_params))
        best = second.result() or evaluator.run(policy)
    summary = {
        **_identity(policy, request),
        **_played(policy, best, request, reporter),
        "last_iterate": return_figures(last),
        **training_figures(planner, result),
    }
    with folder.writing():
        write_training(folder.staging, result, policy, summary)
        write_summary(folder.staging, policy.config, summary)
    folder.commit()
    return summary


def _race(request: PlanRequest, reporter: Reporter, folder: RunFolder) -> dict[str, Any]:
    outcome = _plan_automatically(request, reporter)
    policy = outcome.policy
    reporter.stage("evaluating")
    evaluator = Evaluator(request, reporter)
    summary = {
        **_identity(policy, request),
        **_played(policy, evaluator.run(policy), request, reporter),
        **race_figures(outcome),
    }
    with folder.writing():
        write_race(folder.staging, outcome, summary)
        write_summary(folder.staging, outcome.config, summary)
    folder.commit()
    return summary


def _played(
    policy: AnyPolicy, plain: Evaluation, request: PlanRequest, reporter: Reporter
) -> dict[str, Any]:
    """The figures of the evaluation, with thinking at the decisions if that was asked for."""
    # a table plays its optimum already
    if request.decision_seconds == 0.0 or not isinstance(policy, Policy):
        return return_figures(plain)
    return think(policy, plain, request.decision_seconds, request, reporter)


def _identity(policy: AnyPolicy, request: PlanRequest) -> dict[str, Any]:
    return identity(
        policy.problem,
        policy_figures(policy),
        config_name=request.config_name,
        seed=policy.seed,
        episodes=request.episodes,
    )


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

            key = jax.random.PRNGKey(request.seed)
            result = train(built, key, on_progress=on_progress)
    except InputError as error:
        raise InputError(
            f"{request.problem.instance_path}: {error} (configured by {request.config.source})"
        ) from error
    return planner, result


def _plan_automatically(request: PlanRequest, reporter: Reporter) -> "RaceOutcome":
    # the search's package takes long to import, which other presets need not wait for
    from mdpo_rddl.auto import RaceOptions, plan_automatically

    options = RaceOptions(request.programs, reporter.stage, reporter.training)
    return plan_automatically(request.problem, request.config, request.seed, options)
