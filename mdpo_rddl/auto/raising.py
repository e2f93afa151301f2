"""Whether the environment raises an error in play, as where a probability leaves [0, 1]."""

import dataclasses
import logging
from collections.abc import Callable

from pyRDDLGym.core.debug.exception import RDDLValueOutOfRangeError

from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.problem.load import Problem, make_environment

logger = logging.getLogger(__name__)

RAISING_SHARE = 0.01
"""Of a race's time: what the episode may take."""


def watched(problem: Problem, has_time: Callable[[], bool]) -> Problem:
    """The problem, with `raises` where an episode of the no-op ends in an error.

    Args:
      problem: the parsed problem.
      has_time: asked for before each step of the episode.
    """
    env = make_environment(problem)
    env.reset(seed=0)
    try:
        while not env.done and has_time():
            env.step({})
    except RDDLValueOutOfRangeError as error:
        told = "the environment raises an error if nothing is done, policies must avoid it: %s"
        logger.warning(told, one_line_cause(error))
        return dataclasses.replace(problem, raises=True)
    except Exception as error:  # whoever plays the result will hear of it
        logger.info("the no-op's episode failed: %s", one_line_cause(error))
    return problem
