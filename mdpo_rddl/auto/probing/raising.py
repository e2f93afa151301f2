"""Whether the environment raises an error in play, as where a probability leaves [0, 1]."""

import dataclasses
import logging
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pyRDDLGym.core.debug.exception import RDDLValueOutOfRangeError

from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.problem.legality import Referee
from mdpo_rddl.problem.load import Problem, make_environment
from mdpo_rddl.problem.random_actions import RandomActions

logger = logging.getLogger(__name__)

RAISING_SHARE = 0.01
"""Of a race's time: what the episodes may take."""

_Values = Mapping[str, Any]
_Choose = Callable[[_Values], _Values]


def watched(problem: Problem, has_time: Callable[[], bool]) -> Problem:
    """The problem, with `raises` where an episode of the no-op, or of random actions, fails.

    Args:
      problem: the parsed problem.
      has_time: asked for before each step of the two episodes.
    """
    cause = _failure(problem, lambda: _noop, has_time)
    told = "where nothing is done, or a legal action in its place"
    if cause is None:
        cause, told = _failure(problem, lambda: _random(problem), has_time), "for some actions"
    if cause is None:
        return problem
    logger.warning("the environment raises an error %s, policies must avoid it: %s", told, cause)
    return dataclasses.replace(problem, raises=True)


def _failure(
    problem: Problem, make: Callable[[], _Choose], has_time: Callable[[], bool]
) -> str | None:
    """Why an episode ends in an error of a value out of range; None if it does not."""
    if not has_time():
        return None
    try:
        choose, env = make(), make_environment(problem)
        referee = Referee(env)  # what is illegal is never played
        state, _ = env.reset(seed=0)
        while not env.done and has_time():
            state, *_ = env.step(referee.rule(choose(state)).actions)
    except RDDLValueOutOfRangeError as error:
        return one_line_cause(error)
    except Exception as error:  # whoever plays the result will hear of it
        logger.info("an episode failed: %s", one_line_cause(error))
    return None


def _noop(state: _Values) -> _Values:
    return {}


def _random(problem: Problem) -> _Choose:
    actions, random = RandomActions(problem), np.random.default_rng(0)
    return lambda state: actions.draw(state, random)
