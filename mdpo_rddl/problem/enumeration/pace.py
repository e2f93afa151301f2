"""Giving an enumeration up before its time is over, once it is plain that it cannot end in time."""

from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError

# of the time: before that the pace is not known
_LEAST_SHARE = 0.05
# from one depth to the next: no faster growth is believed to last, and that for two depths only
_GROWTH, _DEPTHS = 1.5, 2


class Pace:
    """How fast states are expanded, or laws made, against the time that is left."""

    def __init__(self, limits: EnumerationLimits, what: str = "states") -> None:
        """Begins to count the time.

        Args:
          limits: of the enumeration.
          what: is counted, in messages.
        """
        self._limits, self._began, self._what = limits, limits.used, what

    def check(self, done: int, waiting: float) -> None:
        """Raises `NotEnumerableError` if what waits takes longer than the time left.

        Args:
          done: what was expanded or made.
          waiting: what is not yet.
        """
        limits = self._limits
        used = limits.used - self._began
        if not done or used < _LEAST_SHARE * limits.seconds:
            return
        needed, left = waiting * used / done, limits.seconds - limits.used
        if needed > left:
            raise NotEnumerableError(
                f"{waiting:,.0f} {self._what} more would take {needed:.0f} s, "
                f"and {left:.0f} s are left"
            )


def expected(latest: int, before: int, depths: int) -> float:
    """How many states are to be expanded, at least, if the growth goes on for a little.

    Args:
      latest: states of the latest depth.
      before: those of the depth before it.
      depths: how many are left after the latest one.
    """
    growth = min(_GROWTH, latest / max(1, before))
    further = min(_DEPTHS, depths) if growth > 1.0 else 0
    return float(sum(latest * growth**number for number in range(further + 1)))
