"""Clocks that do not wait."""

from dataclasses import dataclass


@dataclass
class Ticking:
    """A clock that is a tick later each time it is asked: the same on any machine."""

    tick: float = 1.0
    now: float = 0.0

    def __call__(self) -> float:
        self.now += self.tick
        return self.now


@dataclass
class Stopped:
    """A clock that moves only when it is told to."""

    now: float = 0.0

    def __call__(self) -> float:
        return self.now
