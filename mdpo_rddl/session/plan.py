"""Find a policy once, by one training or by the race of the preset `auto`, then evaluate it."""

import contextlib
import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.machine.logs import kept_warnings
from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.policy.rule.explanation import is_compiled
from mdpo_rddl.problem.evaluation import Evaluation
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.problem.played import NotPlayedError
from mdpo_rddl.session.checkpoints import training_checkpoints
from mdpo_rddl.session.evaluator import Evaluator
from mdpo_rddl.session.find import find_by_race, find_by_training, is_race
from mdpo_rddl.session.movie import draw_movie
from mdpo_rddl.session.observed import LONGEST_EPISODE_SECONDS, Observed, warn_of
from mdpo_rddl.session.race_checkpoints import RaceCheckpoints
from mdpo_rddl.session.report.page.write import add_page
from mdpo_rddl.session.report.race import race_figures, write_race
from mdpo_rddl.session.report.run_folder import RunFolder, write_summary
from mdpo_rddl.session.report.summary import (
    identity,
    not_played_figures,
    policy_figures,
    return_figures,
    training_figures,
    warn_of_unplayable,
)
from mdpo_rddl.session.report.training import write_training
from mdpo_rddl.session.requests import PlanRequest, Reporter
from mdpo_rddl.session.second_evaluator import SecondEvaluator
from mdpo_rddl.session.thinking import (
    choice_times,
    think,
    without_choice,
)
from mdpo_rddl.session.unfinished import RACE_FILES, TRAINING_FILES

if TYPE_CHECKING:
    from mdpo_rddl.auto.common.candidate import Judged
    from mdpo_rddl.auto.outcome.outcome import RaceOutcome

logger = logging.getLogger(__name__)

# for what the terms of a rule are worth
_EXPLAINING_SECONDS = 0.5
# of a run that was stopped
_FEW_EPISODES = 5


class _Found(NamedTuple):
    """What a run has found.

    Attributes:
      policy: the result.
      observed: how it plays.
      summary: what is known so far.
      write: writes the policy and all that goes with it, given the whole summary.
      is_finished: whether nobody has stopped the run.
    """

    policy: AnyPolicy
    observed: Observed
    summary: dict[str, Any]
    write: Callable[[Path, Mapping[str, Any]], None]
    is_finished: bool


def plan(request: PlanRequest, reporter: Reporter) -> dict[str, Any]:
    """Finds a policy, evaluates it exactly and writes the run folder.

    Returns:
      The summary, as `summary.json` holds it.

    Raises:
      InputError: if the problem, the configuration or the folder cannot be used; nothing
        is left behind then. Also if the environment fails while the policy is played; the run
        folder has the policy then, and the cause as "not_played" in its summary.
    """
    race = is_race(request.config)
    find, own = (_race, RACE_FILES) if race else (_train_once, TRAINING_FILES)
    with RunFolder(request.out, request.resume) as folder, kept_warnings() as warnings:
        if other := sorted(set(folder.checkpoints) - set(own)):
            path = folder.unfinished / other[0]
            raise InputError(f"{path}: cannot be resumed: it is of another configuration")
        warn_of(request.problem)
        found = find(request, reporter, folder.unfinished)
        cause = found.summary.get("not_played")
        shown = {} if cause else found.observed.figures(found.summary["returns"])
        summary = found.summary | shown | {"warnings": warnings, "command": request.command}
        with folder.writing():
            found.write(folder.staging, summary)
            if not cause:
                found.observed.write(folder.staging)
        if not cause:
            add_page(folder)
        folder.commit(found.is_finished)
    if cause:
        raise InputError(f"{cause}; the policy is in {folder.target}, not played")
    if request.movie is not None and found.is_finished:
        reporter.stage("drawing")
        draw_movie(request.movie, found.policy, request.problem, request.seed)
    return summary


def _train_once(request: PlanRequest, reporter: Reporter, unfinished: Path) -> _Found:
    with contextlib.ExitStack() as stack:
        second = stack.enter_context(SecondEvaluator(request))
        checkpoints = training_checkpoints(unfinished, request, request.checkpoint_seconds)
        policy, result = find_by_training(
            without_choice(request), reporter, checkpoints=checkpoints
        )
        planner, hyperparams = policy.planner, policy.policy_hyperparams
        is_finished = result.status != "interrupted"
        request = request if is_finished else _shortened(request)
        observed = Observed(request)
        reporter.stage("evaluating")
        evaluator = Evaluator(request, reporter)
        if is_finished:
            second.begin(result.last_params, hyperparams)
        best = _tried(evaluator, policy, observed)
        if isinstance(best, Evaluation):
            warn_of_unplayable(best)
        last = second.result() or _tried(evaluator, policy.with_params(result.last_params))
    summary = {
        **_identity(policy, request),
        **_played(policy, best, request, reporter, observed),
        "last_iterate": _figures(last),
        **training_figures(planner, result),
    }

    def write(folder: Path, summary: Mapping[str, Any]) -> None:
        write_training(folder, result, policy, summary)
        write_summary(folder, policy.config, summary)

    return _Found(policy, observed, summary, write, is_finished)


def _shortened(request: PlanRequest) -> PlanRequest:
    """What is evaluated of a run that somebody has stopped, and waits for."""
    episodes = min(request.episodes, _FEW_EPISODES)
    return replace(request, episodes=episodes, decision_seconds=0.0)


def _race(request: PlanRequest, reporter: Reporter, unfinished: Path) -> _Found:
    from mdpo_rddl.auto.outcome.confirmation import less_than_judged  # takes long to import

    outcome = _raced(request, reporter, unfinished)
    policy = outcome.policy
    if outcome.interrupted:
        request = _shortened(request)
    observed = Observed(request)
    reporter.stage("evaluating")
    # compiled now, no decision's time has that in it
    policy(0, make_environment(request.problem).reset(seed=0)[0])
    plain = _tried(Evaluator(request, reporter), policy, observed)
    if isinstance(plain, Evaluation):
        warn_of_unplayable(plain)
        if less := less_than_judged(outcome.chosen, plain):
            logger.warning("%s; try another --seed", less)
    summary = {
        **_identity(policy, request),
        **_played(policy, plain, request, reporter, observed, outcome.seconds),
        **race_figures(outcome),
        "rule": _rule(policy, observed, outcome.was_played, outcome.interrupted),
    }

    def write(folder: Path, summary: Mapping[str, Any]) -> None:
        write_race(folder, outcome, summary)
        write_summary(folder, outcome.config, summary)

    return _Found(policy, observed, summary, write, not outcome.interrupted)


def _raced(request: PlanRequest, reporter: Reporter, unfinished: Path) -> "RaceOutcome":
    """The race, which leaves its incumbent behind and goes on from an earlier one's."""
    from mdpo_rddl.auto import RaceOptions  # takes long to import

    kept = RaceCheckpoints(unfinished, request, request.checkpoint_seconds)

    def judged(one: "Judged") -> None:
        reporter.judged(one)
        kept.judged(one)

    options = RaceOptions(
        traced_cache=request.traced_cache,
        on_stage=reporter.stage,
        on_progress=reporter.training,
        on_judged=judged,
        earlier=kept.start,
        on_begun=kept.begun,
        on_pulse=kept.pulse,
    )
    outcome = find_by_race(without_choice(request), reporter, options)
    if outcome.interrupted:
        kept.stopped(outcome.seconds)
    return outcome


def _tried(
    evaluator: Evaluator, policy: AnyPolicy, observed: Observed | None = None
) -> Evaluation | NotPlayedError:
    """Plays a policy, which is to be kept even where the environment fails."""
    try:
        found = evaluator.run(policy, observed)
    except NotPlayedError as error:
        return error
    if observed is not None:
        observed.play_side_by_side(policy)
    return found


def _figures(found: Evaluation | NotPlayedError) -> dict[str, Any]:
    if isinstance(found, NotPlayedError):
        return not_played_figures(str(found))
    return return_figures(found)


def _played(
    policy: AnyPolicy,
    plain: Evaluation | NotPlayedError,
    request: PlanRequest,
    reporter: Reporter,
    observed: Observed,
    used: float = math.inf,
) -> dict[str, Any]:
    """The figures of the evaluation, with thinking if that was asked for.

    Args:
      policy: the result.
      plain: what it returned without thinking.
      request: what was asked for.
      reporter: hears of the stages.
      observed: how it plays.
      used: seconds that finding it took.
    """
    figures = _figures(plain)
    if isinstance(plain, NotPlayedError):
        return figures
    if request.decision_seconds > 0.0:
        times = choice_times(request, used)
        figures = think(policy, plain, times, request, reporter, observed)
    return figures


def _rule(
    policy: AnyPolicy, observed: Observed, was_played: bool, in_haste: bool
) -> dict[str, Any] | None:
    """The lifted rule in words, if the policy is one; what its terms are worth if that is cheap.

    Args:
      policy: the result.
      observed: how it plays.
      was_played: whether the race has played policies of its planner.
      in_haste: whether nothing may be compiled for it.
    """
    if not isinstance(policy, Policy) or observed.episode_seconds > LONGEST_EPISODE_SECONDS:
        return None
    # the race has compiled what plays the terms, except for large problems or if it was too late
    is_cheap = was_played and is_compiled(policy.planner)
    if in_haste and not is_cheap:
        return None
    seconds = _EXPLAINING_SECONDS if is_cheap else 0.0
    try:
        explanation = policy.explain(seconds)
    except Exception as error:  # which must not cost the run
        logger.warning("no rule: %s: %s", type(error).__name__, one_line_cause(error))
        return None
    return explanation.to_json() if explanation.equations else None


def _identity(policy: AnyPolicy, request: PlanRequest) -> dict[str, Any]:
    return identity(
        policy.problem,
        policy_figures(policy),
        config_name=request.config_name,
        seed=policy.seed,
        episodes=request.episodes,
    )
