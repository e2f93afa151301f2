"""Plays a session's policy with a time for thinking at each decision."""

import contextlib
import dataclasses
import logging
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from mdpo_rddl.errors import InputError, note_heard, one_line_cause
from mdpo_rddl.machine.files import finite_or_none
from mdpo_rddl.policy.kinds import AnyPolicy
from mdpo_rddl.policy.lookahead.choice import Choice, choice_share, choose, longest_choice
from mdpo_rddl.policy.lookahead.statistics import decision_figures
from mdpo_rddl.problem.evaluation import Evaluation
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.played import NotPlayedError
from mdpo_rddl.session.evaluator import Evaluator
from mdpo_rddl.session.observed import Observed
from mdpo_rddl.session.report.summary import return_figures
from mdpo_rddl.session.requests import EvaluationTerms, PlanRequest, Reporter

logger = logging.getLogger(__name__)

# of the time for planning: for the programs, and never more than
_LEAST_SECONDS, _LARGEST_SHARE = 8.0, 0.5


def choice_seconds(problem: Problem, seconds: float, decision_seconds: float) -> float:
    """How much of the time for planning is kept for preparing to think.

    0 where thinking was not asked for.

    Args:
      problem: what is planned.
      seconds: for planning, in all.
      decision_seconds: of a decision; 0 if thinking was not asked for.
    """
    if decision_seconds == 0.0:
        return 0.0
    share = choice_share(problem)
    wanted = min(max(share * seconds, _LEAST_SECONDS), _LARGEST_SHARE * seconds)
    return min(wanted, longest_choice(decision_seconds))


def with_leftover(kept: float, left: float, decision_seconds: float) -> float:
    """Seconds of the choice once a policy was found.

    Args:
      kept: for it, from the beginning.
      left: of the time for planning.
      decision_seconds: of a decision.
    """
    return max(kept, min(left, longest_choice(decision_seconds)))


def choice_times(request: PlanRequest, used: float = math.inf) -> tuple[float, float]:
    """Seconds of a decision, and of the choice, for a request.

    Args:
      request: what to plan.
      used: seconds that finding the policy took; what it has left over is the choice's too.
    """
    seconds, decision = request.config.budget().seconds, request.decision_seconds
    kept = choice_seconds(request.problem, seconds, decision)
    return decision, with_leftover(kept, seconds - used, decision)


def without_choice(request: PlanRequest) -> PlanRequest:
    """The request with what finding a policy has of its time."""
    kept = choice_times(request)[1]
    if kept == 0.0:
        return request
    left = request.config.budget().seconds - kept
    config = request.config.with_values("Optimize", train_seconds=left)
    return dataclasses.replace(request, config=config)


def think(
    policy: AnyPolicy,
    plain: Evaluation,
    times: tuple[float, float],
    terms: EvaluationTerms,
    reporter: Reporter,
    observed: Observed | None = None,
) -> dict[str, Any]:
    """Chooses whether thinking pays and, if so, plays the same episodes with it.

    Where that fails or is stopped, a warning says so, and the figures are those without thinking.

    Args:
      policy: the prepared policy.
      plain: what it returned without thinking.
      times: seconds of a decision, the first included, and of the choice.
      terms: how the policy is played.
      reporter: hears of the stages.
      observed: keeps how the policy plays with thinking, if that was chosen.

    Returns:
      The figures of the returns, with thinking if it was chosen, and under "thinking" how
      decisions were made.

    Raises:
      InputError: if a policy that was loaded cannot be used for it.
    """
    with costing_nothing():
        return _thought(policy, plain, times, terms, reporter, observed)
    return return_figures(plain)


@contextlib.contextmanager
def costing_nothing() -> Iterator[None]:
    """Preparing or playing in it may fail or be stopped, with a warning: there is a policy.

    Raises:
      InputError: if a policy that was loaded cannot be used for it.
    """
    try:
        yield
    except KeyboardInterrupt as stop:
        note_heard(stop)
        logger.warning("no thinking: stopped")
    except NotPlayedError as error:
        logger.warning("no thinking: %s", one_line_cause(error))
    except InputError:
        raise
    except Exception as error:
        logger.warning("no thinking: %s: %s", type(error).__name__, one_line_cause(error))
        logger.debug("no thinking", exc_info=True)


def _thought(
    policy: AnyPolicy,
    plain: Evaluation,
    times: tuple[float, float],
    terms: EvaluationTerms,
    reporter: Reporter,
    observed: Observed | None,
) -> dict[str, Any]:
    reporter.stage("preparing to think")
    seconds, within = times
    choice = choose(policy, seconds, within)
    thinking = {"decision_seconds": seconds, **_choice_figures(choice)}
    if choice.policy is None:
        return {**return_figures(plain), "thinking": thinking}
    reporter.stage("thinking")
    with contextlib.nullcontext() if observed is None else observed.replaced() as thought:
        played = Evaluator(terms, reporter).run(choice.policy, thought)
    gains = played.returns - plain.returns
    error = float(np.std(gains, ddof=1) / np.sqrt(len(gains))) if len(gains) > 1 else None
    thinking |= decision_figures(choice.policy.decisions, seconds, terms.episodes)
    thinking |= {
        "plain_mean_return": finite_or_none(plain.mean),
        "realised_gain": finite_or_none(float(np.mean(gains))),
        "realised_gain_error": None if error is None else finite_or_none(error),
    }
    return {**return_figures(played), "thinking": thinking}


def _choice_figures(choice: Choice) -> dict[str, Any]:
    return {
        "method": None if choice.policy is None else choice.policy.label,
        "reason": choice.reason,
        "prepare_seconds": round(choice.seconds, 3),
        "trials": [
            {
                "method": trial.method,
                "mean_gain": _number(trial.mean),
                "error": _number(trial.error),
                "states": trial.states,
                "note": trial.note,
            }
            for trial in choice.trials
        ],
    }


def _number(value: float | None) -> float | None:
    return None if value is None else finite_or_none(value)
