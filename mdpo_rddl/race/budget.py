"""How much time there is: made once, where a command or a call begins, and passed on."""

import time
from collections.abc import Callable
from dataclasses import dataclass


class DeadlineError(Exception):
    """A budget is spent in the midst of something that is not worth finishing."""


@dataclass(frozen=True)
class Budget:
    """A span of time.

    Attributes:
      began: when it began, by the clock.
      deadline: when it ends, by the clock.
      clock: tells the seconds.
    """

    began: float
    deadline: float
    clock: Callable[[], float] = time.monotonic

    @classmethod
    def of(cls, seconds: float, clock: Callable[[], float] = time.monotonic) -> "Budget":
        """So many seconds from now."""
        now = clock()
        return cls(now, now + seconds, clock)

    @property
    def seconds(self) -> float:
        """All of it."""
        return self.deadline - self.began

    @property
    def used(self) -> float:
        """Seconds since it began."""
        return self.clock() - self.began

    @property
    def left(self) -> float:
        """Seconds until it ends; below 0 after that."""
        return self.deadline - self.clock()

    def check(self) -> None:
        """Raises `DeadlineError` once it is spent."""
        if self.left <= 0.0:
            raise DeadlineError

    def share(self, part: float) -> "Budget":
        """From now on, a part of what is left."""
        now = self.clock()
        return Budget(now, now + part * max(0.0, self.deadline - now), self.clock)
