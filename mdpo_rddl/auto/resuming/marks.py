"""Where a race is: which of its parts are over, when the others end, and what was decided."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Protocol

from mdpo_rddl.auto.common.state import count_of

RANDOM, SLICES = "random", "slices"
"""Decisions that are numbers: the return of random actions, and slices given in the rounds."""


class _Timed(Protocol):
    """What has a race's time."""

    @property
    def began(self) -> float: ...

    @property
    def deadline(self) -> float: ...

    @property
    def clock(self) -> Callable[[], float]: ...


class Marks:
    """Notes of the parts of a race, by which another process enters it where it was stopped.

    A part that was over is left out then, one that had begun ends when it would have ended, or as
    soon as it has handed in what it has, and what was decided is not decided again. In a race that
    begins they change nothing.
    """

    def __init__(self, earlier: Mapping[str, Any] | None = None) -> None:
        """Goes on with what an earlier race has noted.

        Raises:
          AttributeError, TypeError, ValueError: if that is nothing of the kind.
        """
        earlier = earlier or {}
        self._ends = {str(part): float(end) for part, end in earlier.get("ends", {}).items()}
        self._begun = {str(part) for part in earlier.get("begun", ())}
        self._over = {str(part) for part in earlier.get("over", ())}
        self._decided = dict(earlier.get("decided", {}))
        self._earlier = frozenset(self._ends)
        for part, end in self._ends.items():
            if not math.isfinite(end):
                raise ValueError(f"its part {part!r} ends after {end} seconds")
        for name, value in self._decided.items():
            _check(name, value)

    def values(self) -> dict[str, Any]:
        """All of it, as JSON can hold it; ends are in seconds since the race began."""
        return {
            "ends": dict(self._ends),
            "begun": sorted(self._begun),
            "over": sorted(self._over),
            "decided": dict(self._decided),
        }

    def end(self, part: str, race: _Timed, until: float) -> float:
        """When a part ends, by the clock.

        Args:
          part: its name.
          race: that it is a part of.
          until: when it ends if it begins now.

        Returns:
          The race's deadline at the latest.
        """
        seconds = self._ends.setdefault(part, until - race.began)
        return min(race.began + seconds, race.deadline)

    def once(self, part: str, race: _Timed, until: float) -> Iterator[float]:
        """One turn with the end of a part, or none if the part is over.

        The other arguments are those of `end`.
        """
        until = self.end(part, race, until)
        is_late = part in self._earlier and part not in self._begun and race.clock() >= until
        if part not in self._over and not is_late:
            self._begun.add(part)
            yield until
        self._over.add(part)

    def is_over(self, part: str) -> bool:
        """Whether the part has ended."""
        return part in self._over

    def ended(self, part: str) -> None:
        """A part without a time of its own has ended."""
        self._over.add(part)

    def decided(self, name: str, decide: Callable[[], Any]) -> Any:
        """What was decided, or is decided now: a truth or a number.

        A number that is not finite is decided anew by the next race.
        """
        if name in self._decided:
            return self._decided[name]
        value = decide()
        if math.isfinite(value):
            self._decided[name] = value
        return value

    def decide(self, name: str, value: bool | float) -> None:
        """Notes a decision, in place of an earlier one."""
        self._decided[name] = value


def _check(name: str, value: Any) -> None:
    """Raises TypeError or ValueError if a decision is not of its type."""
    if name == SLICES:
        if not math.isfinite(value):
            raise ValueError(f"its slices are {value}")
        count_of(value)
    elif name == RANDOM:
        if not math.isfinite(value):
            raise ValueError(f"its return of random actions is {value}")
    elif not isinstance(value, bool):
        raise ValueError(f"its decision {name!r} is {value!r:.40}, and no truth")
