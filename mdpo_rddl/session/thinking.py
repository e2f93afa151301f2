"""Plays a session's policy with a time for thinking at each decision."""

from typing import Any

import numpy as np

from mdpo_rddl.policy.lookahead.choice import Choice, choose
from mdpo_rddl.policy.lookahead.statistics import decision_figures
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.problem.evaluation import Evaluation
from mdpo_rddl.session.evaluator import Evaluator
from mdpo_rddl.session.observed import Observed
from mdpo_rddl.session.report.summary import finite_or_none, return_figures
from mdpo_rddl.session.requests import EvaluationTerms, Reporter


def think(
    policy: Policy,
    plain: Evaluation,
    seconds: float,
    terms: EvaluationTerms,
    reporter: Reporter,
    observed: Observed | None = None,
) -> dict[str, Any]:
    """Chooses whether thinking pays and, if so, plays the same episodes with it.

    Args:
      policy: the prepared policy.
      plain: what it returned without thinking.
      seconds: of a decision, the first included.
      terms: how the policy is played.
      reporter: hears of the stages.
      observed: keeps how the policy plays with thinking, if that was chosen.

    Returns:
      The figures of the returns, with thinking if it was chosen, and under "thinking" how
      decisions were made.
    """
    reporter.stage("preparing to think")
    choice = choose(policy, seconds)
    thinking = {"decision_seconds": seconds, **_choice_figures(choice)}
    if choice.policy is None:
        return {**return_figures(plain), "thinking": thinking}
    reporter.stage("thinking")
    played = Evaluator(terms, reporter).run(choice.policy, observed)
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
        "method": None if choice.policy is None else choice.policy.method.name,
        "reason": choice.reason,
        "prepare_seconds": round(choice.seconds, 3),
        "trials": [
            {
                "method": trial.method,
                "mean_gain": finite_or_none(trial.mean),
                "error": finite_or_none(trial.error),
            }
            for trial in choice.trials
        ],
    }
