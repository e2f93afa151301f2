"""How far an enumeration may go, and the one way in which it gives up."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field


class NotEnumerableError(Exception):
    """The states of a problem cannot be enumerated, or not within the limits; says why."""


class OutOfTimeError(NotEnumerableError):
    """The clock says so, whatever the problem is."""


@dataclass(frozen=True)
class EnumerationLimits:
    """What an enumeration may use.

    Attributes:
      seconds: of time by the clock, from the making of this object.
      states: reachable states.
      transitions: successors with a positive probability, over all states and actions.
      actions: joint actions.
      clock: what tells the time.
    """

    seconds: float = 60.0
    states: int = 4_000_000
    transitions: int = 30_000_000
    actions: int = 5_000
    clock: Callable[[], float] = time.monotonic
    _started: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_started", self.clock())

    @property
    def used(self) -> float:
        """Seconds since the making of this object."""
        return self.clock() - self._started

    def check_time(self) -> None:
        """Raises `OutOfTimeError` once the time is over."""
        if self.used > self.seconds:
            raise OutOfTimeError(f"more than {self.seconds:g} s")

    def check_states(self, count: int) -> None:
        """Raises `NotEnumerableError` for too many states."""
        if count > self.states:
            raise NotEnumerableError(f"more than {self.states:,} states")

    def check_transitions(self, count: int) -> None:
        """Raises `NotEnumerableError` for too many transitions."""
        if count > self.transitions:
            raise NotEnumerableError(f"more than {self.transitions:,} transitions")
