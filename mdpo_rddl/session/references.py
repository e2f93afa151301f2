"""The no-op and random actions on the episodes that a policy is played on."""

import time
from collections.abc import Callable

import numpy as np

from mdpo_rddl.problem.episode import EpisodesRecorder, Policy
from mdpo_rddl.problem.evaluation import Evaluation, evaluate
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.problem.random_actions import RandomActions
from mdpo_rddl.session.requests import EvaluationTerms


def noop_evaluation(
    terms: EvaluationTerms,
    seconds: float,
    recorder: EpisodesRecorder | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Evaluation:
    """Plays the no-op: the first of the evaluation's episodes, as many as the time allows.

    Args:
      terms: of the policy's evaluation.
      seconds: after which no further episode begins.
      recorder: keeps the episodes.
      clock: tells the seconds.
    """
    return _played(terms, lambda step, state: {}, seconds, recorder, clock)


def random_evaluation(
    terms: EvaluationTerms, seconds: float, clock: Callable[[], float] = time.monotonic
) -> Evaluation:
    """Plays random legal actions: the first of the evaluation's episodes, as `noop_evaluation`."""
    actions, rng = RandomActions(terms.problem), np.random.default_rng(terms.seed)
    return _played(terms, lambda step, state: actions.draw(state, rng), seconds, None, clock)


def _played(
    terms: EvaluationTerms,
    policy: Policy,
    seconds: float,
    recorder: EpisodesRecorder | None,
    clock: Callable[[], float],
) -> Evaluation:
    env = make_environment(terms.problem)
    until = clock() + seconds

    def has_time() -> bool:
        return clock() < until

    return evaluate(env, policy, terms.episodes, terms.seed, has_time, recorder)
