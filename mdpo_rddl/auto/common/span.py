"""A part of the race by the clock, which another process may have begun."""

from collections.abc import Mapping
from typing import Any, NamedTuple, Self


class Span(NamedTuple):
    """A part of the race.

    Attributes:
      began, ends: by the clock.
    """

    began: float
    ends: float

    @classmethod
    def of(cls, values: Mapping[str, Any], race: float, seconds: float) -> Self:
        """The part that an earlier process has begun.

        Args:
          values: with `began` and `ends`, in seconds from the beginning of the race.
          race: when this process's race began, by the clock.
          seconds: of the race.

        Raises:
          ValueError: if it is no part of the race.
        """
        began, ends = float(values["began"]), float(values["ends"])
        # the clocks of two processes round differently
        if not 0.0 <= began <= ends <= seconds + 1.0:
            raise ValueError(f"it learns from {began} to {ends} s of {seconds}")
        return cls(race + began, race + ends)

    def share(self, now: float) -> float:
        """How much of it is over, at most 1."""
        return min(1.0, (now - self.began) / max(self.ends - self.began, 1e-9))
