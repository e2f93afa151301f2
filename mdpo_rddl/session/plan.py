"""Find a policy once, by one training or by the race of the preset `auto`, then evaluate it."""

import contextlib
import logging
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from mdpo_rddl.errors import InputError, note_heard, one_line_cause
from mdpo_rddl.machine.logs import kept_warnings
from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.problem.evaluation import Evaluation
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.problem.played import NotPlayedError
from mdpo_rddl.session.evaluator import Evaluator
from mdpo_rddl.session.observed import Observed, warn_of
from mdpo_rddl.session.race import (
    RaceHooks,
    RaceResult,
    find_by_race,
    is_race,
    less_than_promised,
)
from mdpo_rddl.session.race_progress import RaceProgress
from mdpo_rddl.session.report.page.write import add_page
from mdpo_rddl.session.report.race import race_figures, write_race
from mdpo_rddl.session.report.run_folder import RunFolder, write_summary
from mdpo_rddl.session.report.summary import (
    identity,
    no_return_figures,
    not_played_figures,
    policy_figures,
    return_figures,
    warn_of_unplayable,
)
from mdpo_rddl.session.requests import PlanRequest, Reporter
from mdpo_rddl.session.unfinished import RACE_FILES, TRAINING_FILES

logger = logging.getLogger(__name__)

# for what the terms of a rule are worth
_EXPLAINING_SECONDS = 0.25
# of a run that was stopped, for its episodes, and what an episode may have taken of which more is
# played than these
_SECONDS_IN_HASTE, _EPISODE_IN_HASTE = 0.5, 0.1


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
        cause, returns = found.summary.get("not_played"), found.summary["returns"]
        shown: dict[str, Any] = {}
        if returns:
            with _left_out_if_stopped("references"):
                shown = found.observed.figures(returns)
        summary = found.summary | shown | {"warnings": warnings, "command": request.command}
        with folder.writing():
            _despite_a_stop(lambda: found.write(folder.staging, summary))
            if returns:
                _despite_a_stop(lambda: found.observed.write(folder.staging))
        if returns:
            with _left_out_if_stopped("report.html"):
                add_page(folder)
        _despite_a_stop(lambda: folder.commit(found.is_finished))
    if cause:
        raise InputError(f"{cause}; the policy is in {folder.target}, not played")
    if request.movie is not None and found.is_finished:
        from mdpo_rddl.session.movie import draw_movie

        reporter.stage("drawing")
        draw_movie(request.movie, found.policy, request.problem, request.seed)
    return summary


@contextlib.contextmanager
def _left_out_if_stopped(what: str) -> Iterator[None]:
    """An interrupt in the block costs what is made there, not the run."""
    try:
        yield
    except KeyboardInterrupt as stop:
        note_heard(stop)
        logger.warning("no %s: stopped", what)


def _despite_a_stop(do: Callable[[], object]) -> None:
    """Does what must be done, once more if it was interrupted: a run has one interrupt at most."""
    try:
        do()
    except KeyboardInterrupt as stop:
        note_heard(stop)
        do()


def _train_once(request: PlanRequest, reporter: Reporter, unfinished: Path) -> _Found:
    # which import JAX
    from mdpo_rddl.session.checkpoints import training_checkpoints
    from mdpo_rddl.session.report.summary import training_figures
    from mdpo_rddl.session.report.training import write_training
    from mdpo_rddl.session.second_evaluator import SecondEvaluator
    from mdpo_rddl.session.training import find_by_training

    with contextlib.ExitStack() as stack:
        second = stack.enter_context(SecondEvaluator(request))
        checkpoints = training_checkpoints(unfinished, request, request.checkpoint_seconds)
        policy, result = find_by_training(
            _without_choice(request), reporter, checkpoints=checkpoints
        )
        planner, hyperparams = policy.planner, policy.policy_hyperparams
        is_finished = result.status != "interrupted"
        observed, evaluator = _evaluation(request, reporter, not is_finished)
        if is_finished:
            second.begin(result.last_params, hyperparams)
        best = _tried(evaluator, policy, observed)
        if isinstance(best, Evaluation):
            warn_of_unplayable(best)
        last = second.result() or _tried(evaluator, policy.with_params(result.last_params))
    is_finished &= not evaluator.was_stopped
    summary = {
        **_identity(policy, request, observed),
        **_played(policy, best, request, reporter, observed),
        "last_iterate": _figures(last),
        **training_figures(planner, result),
    }

    def write(folder: Path, summary: Mapping[str, Any]) -> None:
        write_training(folder, result, policy, summary)
        write_summary(folder, policy.config, summary)

    return _Found(policy, observed, summary, write, is_finished)


def _evaluation(
    request: PlanRequest, reporter: Reporter, in_haste: bool
) -> tuple[Observed, Evaluator]:
    """What plays the result, and what is kept of that.

    Args:
      request: what was asked for.
      reporter: hears of the stage.
      in_haste: whether somebody has stopped the run, and waits.
    """
    reporter.stage("evaluating")
    if not in_haste:
        return Observed(request), Evaluator(request, reporter)
    observed = Observed(request, _EPISODE_IN_HASTE)
    return observed, Evaluator(request, reporter, _SECONDS_IN_HASTE)


def _race(request: PlanRequest, reporter: Reporter, unfinished: Path) -> _Found:
    result = _raced(request, reporter, unfinished)
    policy = result.policy
    observed, evaluator = _evaluation(request, reporter, result.interrupted)
    plain = _tried(evaluator, policy, observed)
    if isinstance(plain, Evaluation):
        warn_of_unplayable(plain)
        if less := less_than_promised(result, plain):
            logger.warning("%s; try another --seed", less)
    was_stopped = result.interrupted or evaluator.was_stopped
    if was_stopped:
        result = replace(result, interrupted=True)
        request = replace(request, decision_seconds=0.0)
    summary = {
        **_identity(policy, request, observed),
        **_played(policy, plain, request, reporter, observed, result.seconds),
        **race_figures(result),
        "rule": None,
    }
    with _left_out_if_stopped("rule in words"):
        summary["rule"] = _rule(policy, observed)

    def write(folder: Path, summary: Mapping[str, Any]) -> None:
        write_race(folder, result, summary)
        write_summary(folder, result.config, summary)

    return _Found(policy, observed, summary, write, not was_stopped)


def _raced(request: PlanRequest, reporter: Reporter, unfinished: Path) -> RaceResult:
    """The race, which leaves its candidates behind and goes on from an earlier one's."""
    kept = RaceProgress(unfinished, request, request.checkpoint_seconds)
    hooks = RaceHooks(
        kept.start.candidates, kept.start.curve, kept.start.seconds, kept.judged, kept.pulse
    )
    result = find_by_race(_without_choice(request), reporter, hooks)
    kept.save(result.seconds)  # who is stopped while the result is played need not race again
    return result


def _without_choice(request: PlanRequest) -> PlanRequest:
    """The request with what finding a policy has of its time."""
    if request.decision_seconds == 0.0:
        return request
    from mdpo_rddl.session.thinking import without_choice  # imports JAX

    return without_choice(request)


def _tried(
    evaluator: Evaluator, policy: AnyPolicy, observed: Observed | None = None
) -> Evaluation | NotPlayedError:
    """Plays a policy, which is to be kept even where the environment fails."""
    try:
        if observed is not None and math.isinf(evaluator.seconds):
            # made now, no decision's time has that in it
            policy(0, make_environment(policy.problem).reset(seed=0)[0])
        found = evaluator.run(policy, observed)
    except NotPlayedError as error:
        return error
    except KeyboardInterrupt as stop:
        note_heard(stop)
        logger.warning("the evaluation was stopped after %d episodes", evaluator.ended)
        return evaluator.so_far()
    if observed is not None and observed.is_quick:
        with _left_out_if_stopped("more trajectories"):
            observed.play_side_by_side(policy)
    return found


def _figures(found: Evaluation | NotPlayedError) -> dict[str, Any]:
    if isinstance(found, NotPlayedError):
        return not_played_figures(str(found))
    if not len(found.returns):
        return no_return_figures()
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
    if request.decision_seconds > 0.0 and figures["returns"]:
        from mdpo_rddl.session.thinking import choice_times, think  # import JAX

        times = choice_times(request, used)
        figures = think(policy, plain, times, request, reporter, observed)
    return figures


def _rule(policy: AnyPolicy, observed: Observed) -> dict[str, Any] | None:
    """The lifted rule in words, if the policy is one, and what some of its terms are worth."""
    if not isinstance(policy, Policy) or not observed.is_quick:
        return None
    try:
        explanation = policy.explain(_EXPLAINING_SECONDS)
    except Exception as error:  # which must not cost the run
        logger.warning("no rule: %s: %s", type(error).__name__, one_line_cause(error))
        return None
    return explanation.to_json() if explanation.equations else None


def _identity(policy: AnyPolicy, request: PlanRequest, observed: Observed) -> dict[str, Any]:
    return identity(
        policy.problem,
        policy_figures(policy),
        config_name=request.config_name,
        seed=policy.seed,
        episodes=observed.episodes,
    )
