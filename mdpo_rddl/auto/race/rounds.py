"""Who gets the next slice of a race: the arm that promises most, and now and then any other.

A successive halving without fixed rungs, after Karnin, Koren and Somekh (2013), "Almost optimal
exploration in multi-armed bandits": an arm whose best return would stay below the incumbent's at
its own pace is not given the slices of those that would not. Arms' gains are anything but
independent draws, though, so that none is ever dropped for good.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from mdpo_rddl.auto.arms.base import FIRST_SLICES, Arm
from mdpo_rddl.machine.cores import usable_cores

# one slice of so many is for the arm that has waited longest
_FLOOR = 8
# gains become smaller: of what the latest pace would gain in the time left
_LASTING = 0.5
# of the pace, after a slice that has gained less
_DECAY = 0.5

Reached = Callable[[], float]
"""Gives the return that was reached so far."""


@dataclass(eq=False)
class Contender:
    """An arm in the rounds.

    Attributes:
      arm: the arm.
      reached: gives the return that the arm goes on from; None before there is any.
      slices: that it was given, other than to wait for a compilation.
      pace: gain a second, lately.
      waited: slices of others since its last one.
    """

    arm: Arm
    reached: Callable[[], float | None]
    slices: int = 0
    pace: float = 0.0
    waited: int = 0

    @property
    def level(self) -> float:
        """The return that the arm goes on from; minus infinity before there is any."""
        reached = self.reached()
        return -math.inf if reached is None else reached

    def claim(self, seconds: float) -> float:
        """What it would reach in so many seconds at its pace."""
        reached = self.reached()
        if reached is None or not math.isfinite(reached):
            return -math.inf
        return reached + _LASTING * self.pace * seconds

    def note(self, before: float | None, seconds: float) -> None:
        """Takes account of a slice.

        Args:
          before: what it went on from.
          seconds: that it took.
        """
        self.slices += 1
        after = self.reached()
        gain = 0.0
        if before is not None and after is not None and math.isfinite(before):
            gain = max(0.0, after - before) / max(seconds, 1e-9)
        self.pace = max(gain, _DECAY * self.pace)


def next_contender(
    contenders: Sequence[Contender], number: int, best: float, seconds: float
) -> Contender | None:
    """Who gets the next slice; None if nobody can use one.

    Args:
      contenders: all of them.
      number: of the slice, from 0.
      best: the incumbent's mean return.
      seconds: that are left.
    """
    able = [c for c in contenders if not (c.arm.is_exhausted or c.arm.is_pending)]
    if not able:
        return None
    first = min(able, key=lambda contender: contender.slices)
    if first.slices < FIRST_SLICES:
        return first
    longest = max(able, key=lambda contender: contender.waited)
    promising = max(able, key=lambda contender: contender.claim(seconds))
    is_floor = number % _FLOOR == _FLOOR - 1
    return longest if is_floor or promising.claim(seconds) <= best else promising


def gives_way(chosen: Contender, pending: Sequence[Arm], best: float, seconds: float) -> bool:
    """Whether an arm that promises nothing would only delay a compilation on the same core.

    Args:
      chosen: who has the next slice.
      pending: arms whose programs are compiled, one after the other.
      best: the incumbent's mean return.
      seconds: that are left.
    """
    if usable_cores() > 1 or not any(arm.is_worth_waiting(seconds) for arm in pending):
        return False
    return chosen.slices > 0 and chosen.claim(seconds) <= best


def raising(reached: Reached, by: Callable[[], float] = lambda: 0.0) -> Iterator[None]:
    """One turn, and others as long as each raises a return.

    Args:
      reached: gives the return, before and after each turn.
      by: gives what the gain of the latest turn must exceed.
    """
    gains = True
    while gains:
        before = reached()
        yield
        gains = reached() > before + by()
