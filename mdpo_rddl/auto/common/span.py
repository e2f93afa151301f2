"""A part of the race by the clock."""

from typing import NamedTuple


class Span(NamedTuple):
    """A part of the race.

    Attributes:
      began, ends: by the clock.
    """

    began: float
    ends: float

    def share(self, now: float) -> float:
        """How much of it is over, at most 1."""
        return min(1.0, (now - self.began) / max(self.ends - self.began, 1e-9))
