"""Find a policy once, by one training or by the race of the preset `auto`, then evaluate it."""

import contextlib
from dataclasses import replace
from typing import Any

from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.problem.evaluation import Evaluation
from mdpo_rddl.session.checkpoints import training_checkpoints
from mdpo_rddl.session.evaluator import Evaluator
from mdpo_rddl.session.find import find_by_race, find_by_training, is_race
from mdpo_rddl.session.race_checkpoints import RaceCheckpoints
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

# of a run that was stopped
_FEW_EPISODES = 5


def plan(request: PlanRequest, reporter: Reporter) -> dict[str, Any]:
    """Finds a policy, evaluates it exactly and writes the run folder.

    Returns:
      The summary, as `summary.json` holds it.

    Raises:
      InputError: if the problem, the configuration or the folder cannot be used; nothing
        is left behind then.
    """
    with RunFolder(request.out, request.resume) as folder:
        return (_race if is_race(request.config) else _train_once)(request, reporter, folder)


def _train_once(request: PlanRequest, reporter: Reporter, folder: RunFolder) -> dict[str, Any]:
    with contextlib.ExitStack() as stack:
        second = stack.enter_context(SecondEvaluator(request))
        seconds = request.checkpoint_seconds
        checkpoints = training_checkpoints(folder.unfinished, request, seconds)
        policy, result = find_by_training(request, reporter, checkpoints=checkpoints)
        planner, hyperparams = policy.planner, policy.policy_hyperparams
        is_finished = result.status != "interrupted"
        request = request if is_finished else _shortened(request)
        reporter.stage("evaluating")
        evaluator = Evaluator(request, reporter)
        if is_finished:
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
    folder.commit(is_finished)
    return summary


def _shortened(request: PlanRequest) -> PlanRequest:
    """What is evaluated of a run that somebody has stopped, and waits for."""
    return replace(request, episodes=min(request.episodes, _FEW_EPISODES), decision_seconds=0.0)


def _race(request: PlanRequest, reporter: Reporter, folder: RunFolder) -> dict[str, Any]:
    from mdpo_rddl.auto import RaceOptions  # takes long to import

    kept = RaceCheckpoints(folder.unfinished, request, request.checkpoint_seconds)
    options = RaceOptions(
        traced_cache=request.traced_cache,
        on_stage=reporter.stage,
        on_progress=reporter.training,
        on_judged=kept.judged,
        start=kept.start,
    )
    outcome = find_by_race(request, reporter, options)
    policy = outcome.policy
    if outcome.interrupted:
        request = _shortened(request)
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
    folder.commit(is_finished=not outcome.interrupted)
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
