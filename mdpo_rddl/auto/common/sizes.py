"""How much of a problem can be computed at once."""

import math
from typing import NamedTuple

import numpy as np

from mdpo_rddl.machine.device import is_on_cpu
from mdpo_rddl.planner.exact.exact import step_bytes, visit_bytes
from mdpo_rddl.planner.planner import MDPOPlanner

# what one step of a search's rollouts may hold: more takes too long rather than too much memory
_AT_ONCE_BYTES = 10**7
# on devices where it takes about as long for little
_AT_ONCE_ELSEWHERE_BYTES = 10**9
_PLANS_BYTES = 10**8
VISITS_BYTES = 2 * 10**8
"""What the states that rollouts have seen, at every step, may take."""
# of a candidate
_FEWEST_ROLLOUTS = 2

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


class Batches(NamedTuple):
    """How constants are played.

    Attributes:
      constants: in all.
      rollouts: of each constant.
      at_once: constants of a batch.
    """

    constants: int
    rollouts: int
    at_once: int


_SIZES = (Size(32, 4, None), Size(32, 1, None), Size(8, 1, 1))
# a few rollouts do not tell how rarely the environment raises an error, which decides there
_TELLING_ERRORS = Size(32, 128, None)


def fitting_size(planner: MDPOPlanner) -> Size:
    """The largest search whose step is small enough.

    Args:
      planner: with a `FeedbackPlan`.
    """
    one = step_bytes(planner)
    most = _AT_ONCE_BYTES if is_on_cpu() else _AT_ONCE_ELSEWHERE_BYTES
    sizes = (_TELLING_ERRORS, *_SIZES) if planner.lose_on_error else _SIZES
    fits = (s for s in sizes if s.population * s.rollouts * one <= most)
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


def visits_fit(planner: MDPOPlanner) -> bool:
    """Whether the states that a population of open-loop plans sees fit into memory with ease.

    Args:
      planner: compiled.
    """
    return PLANS * visit_bytes(planner) <= VISITS_BYTES


def fitting_batches(planner: MDPOPlanner, constants: int, rollouts: int) -> Batches:
    """Batches whose states fit into memory with ease, with fewer rollouts if one does not.

    Args:
      planner: compiled.
      constants: in all.
      rollouts: of each constant, at most.
    """
    most = max(1, VISITS_BYTES // visit_bytes(planner))
    rollouts = min(rollouts, most)
    return Batches(constants, rollouts, min(constants, max(1, most // rollouts)))


def judge_rollouts(most: int, rollout_seconds: float, seconds: float) -> int:
    """Rollouts of each candidate: all but where they take too long.

    Args:
      most: number of them, a power of two.
      rollout_seconds: that one takes.
      seconds: that all of a candidate's may take.
    """
    count = most
    while count > _FEWEST_ROLLOUTS and count * rollout_seconds > seconds:
        count //= 2
    return count
