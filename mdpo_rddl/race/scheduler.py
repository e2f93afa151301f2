"""Which arm works when.

Whoever applies has a short first slice as soon as it is ready. After that each slice goes to the
arm with the most promising claim, one in eight to the one that has waited longest; the end belongs
to whoever can make the leader better. What is compiled or solved beside the others is asked again
and again whether it is ready; nobody waits for it.
"""

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.race.arm import Arm, Context, Turn
from mdpo_rddl.race.board import Board, is_proven
from mdpo_rddl.race.outcome import ArmFigures

logger = logging.getLogger(__name__)

# seconds of a slice at least, and as a share of those that were used
_SHORTEST, _SHARE = 0.05, 0.05
# one slice of so many is for the one that has waited longest
_WAITING = 8
# of the time: when the end begins
_END = 0.85
# between two looks at what is pending, where nobody can work
_PAUSE = 0.01


@dataclass
class _Entry:
    """An arm in the race.

    Attributes:
      arm: the arm.
      state: its latest.
      slices, seconds: that it was given.
      last: when it worked last, in seconds of the race.
      gains: what its slices have gained in all, after so many of its seconds.
    """

    arm: Arm
    state: Any
    slices: int = 0
    seconds: float = 0.0
    last: float = 0.0
    gains: list[tuple[float, float]] = field(default_factory=lambda: [(0.0, 0.0)])

    def reached(self, board: Board) -> float:
        """The return from which its next slice goes on."""
        assert board.leader is not None
        begins = self.arm.improves and board.feedback is not None
        own = board.feedback.mean if begins and board.feedback else self.state.claim
        return own if np.isfinite(own) else board.points[0].mean

    def promise(self, board: Board, left: float) -> float:
        """What it may reach in the seconds left, at the pace of the latest half of its own."""
        seconds, gained = [each for each in self.gains if each[0] <= self.seconds / 2.0][-1]
        pace = (self.gains[-1][1] - gained) / max(self.seconds - seconds, _SHORTEST)
        return self.reached(board) + pace * left


class Schedule:
    """The arms of a race, whose turn it is, and what they did."""

    def __init__(self, context: Context, arms: Sequence[Arm]) -> None:
        """Begins those arms that apply, and what they do beside the others."""
        self._context, self._entries = context, list[_Entry]()
        for arm in arms:
            if (state := arm.init(context)) is not None:
                self._entries.append(_Entry(arm, state))

    def run(self, board: Board) -> None:
        """Gives arms their slices until nobody has anything left to do or the optimum is proven.

        Args:
          board: has judged the no-op; is given whatever is found.

        Raises:
          DeadlineError: when the time is over.
        """
        context, entries, number = self._context, self._entries, 0
        while not is_proven(board.leader):
            context.on_iteration()
            able = [one for one in entries if one.state.is_ready and not one.state.is_exhausted]
            if able:
                _work(context, _next(context, able, board, number), board)
                number += 1
            elif all(one.state.is_exhausted for one in entries):
                return
            else:
                time.sleep(_PAUSE)
            _poll(context, entries, board)

    def figures(self, board: Board) -> list[ArmFigures]:
        """What each arm that applies was given and did."""
        return [_figures(one, board) for one in self._entries]

    def close(self) -> None:
        """Ends what goes on beside."""
        for one in self._entries:
            one.arm.close(one.state)


def _next(context: Context, able: Sequence[_Entry], board: Board, number: int) -> _Entry:
    """Whose turn it is."""
    if new := [one for one in able if not one.slices]:
        return new[0]
    if context.budget.used > _END * context.budget.seconds:
        improving = [one for one in able if _improves(one, board)]
        able = improving or able
    if number % _WAITING == _WAITING - 1:
        return min(able, key=lambda one: one.last)
    left = context.budget.left
    return max(able, key=lambda one: (one.promise(board, left), -one.last))


def _improves(one: _Entry, board: Board) -> bool:
    """Whether an arm goes on with the leader: it is its own, or one that begins at the leader."""
    leader = board.leader
    assert leader is not None
    is_feedback = board.feedback is not None and board.feedback.candidate is leader.candidate
    return one.arm.name == leader.candidate.arm or (is_feedback and one.arm.improves)


def _work(context: Context, one: _Entry, board: Board) -> None:
    """A slice for an arm, and its candidates for the board."""
    budget = context.budget
    assert board.leader is not None
    began, reached = budget.used, one.reached(board)
    length = max(_SHORTEST, _SHARE * began)
    until = min(budget.clock() + length, budget.deadline)
    try:
        one.state = one.arm.step(context, one.state, Turn(until, board.leader, board.feedback))
    except (InputError, ArithmeticError, MemoryError) as error:
        logger.warning("%s gives up: %s", one.arm.name, one_line_cause(error))
        one.state = one.state._replace(is_exhausted=True, found=())
    for candidate in one.state.found:
        board.judge(candidate)
    one.slices += 1
    one.seconds += budget.used - began
    one.last = budget.used
    gain = max(0.0, one.state.claim - reached) if np.isfinite(one.state.claim) else 0.0
    one.gains.append((one.seconds, one.gains[-1][1] + gain))


def _poll(context: Context, entries: Sequence[_Entry], board: Board) -> None:
    """Looks after what goes on beside, and judges what it has found."""
    assert board.leader is not None
    for one in entries:
        if not one.state.is_ready and not one.state.is_exhausted:
            now = context.budget.clock()
            one.state = one.arm.step(context, one.state, Turn(now, board.leader, board.feedback))
            for candidate in one.state.found:
                board.judge(candidate)


def _figures(one: _Entry, board: Board) -> ArmFigures:
    best = board.best_return(one.arm.name)
    given = one.slices, one.seconds, one.state.iterations, best
    return ArmFigures(one.arm.name, *given, one.state.details)
