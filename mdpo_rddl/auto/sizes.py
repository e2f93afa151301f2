"""How much of a problem can be computed at once."""

import math
from typing import NamedTuple

import numpy as np

from mdpo_rddl.planner.exact import step_bytes
from mdpo_rddl.planner.planner import MDPOPlanner

# what one step of a search's rollouts may hold: more takes too long rather than too much memory
_AT_ONCE_BYTES = 10**7
_PLANS_BYTES = 10**8

PLANS = 128
"""Rollouts of open-loop plans in one iteration of the search for them."""


class Size(NamedTuple):
    """How to search on one problem.

    Attributes:
      population: candidates of an iteration.
      rollouts: of each candidate.
      side_by_side: candidates that are computed at once; all if None.
    """

    population: int
    rollouts: int
    side_by_side: int | None


_SIZES = (Size(32, 4, None), Size(32, 1, None), Size(8, 1, 1))


def fitting_size(planner: MDPOPlanner) -> Size:
    """The largest search whose step is small enough.

    Args:
      planner: with a `FeedbackPlan`.
    """
    one = step_bytes(planner)
    fits = (s for s in _SIZES if s.population * s.rollouts * one <= _AT_ONCE_BYTES)
    return next(fits, _SIZES[-1])


def is_large(planner: MDPOPlanner) -> bool:
    """Whether candidates must be computed one by one."""
    return fitting_size(planner).side_by_side is not None


def plans_fit(planner: MDPOPlanner) -> bool:
    """Whether a population of open-loop plans, every step's actions, fits into memory with ease.

    Args:
      planner: with a `FeedbackPlan`.
    """
    shapes = planner.feedback_plan.feedback.action_shapes.values()
    actions = sum(math.prod(shape) for shape in shapes)
    return PLANS * planner.horizon * actions * np.dtype(np.float32).itemsize <= _PLANS_BYTES
