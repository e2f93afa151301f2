"""The clock that everything in `auto` asks, and programs that are timed by it."""

from collections.abc import Callable
from typing import Generic, ParamSpec, TypeVar

Clock = Callable[[], float]
"""Seconds since some moment, as `time.monotonic` gives them."""

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class Timed(Generic[Arguments, Result]):
    """A compiled function that knows how long its calls take; the first one compiles it.

    Attributes:
      calls: number of calls so far.
      seconds: of the latest call.
    """

    def __init__(self, function: Callable[Arguments, Result], clock: Clock) -> None:
        """Calls nothing yet.

        Args:
          function: returns once it has computed its result.
          clock: what times it.
        """
        self._function, self._clock = function, clock
        self._first_seconds = 0.0
        self.calls, self.seconds = 0, 0.0

    def __call__(self, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        """The function's result."""
        started = self._clock()
        result = self._function(*args, **kwargs)
        self.seconds = self._clock() - started
        self._first_seconds = self._first_seconds if self.calls else self.seconds
        self.calls += 1
        return result

    @property
    def compile_seconds(self) -> float:
        """What the first call took longer than the latest; all of it if there was one only."""
        return max(0.0, self._first_seconds - (self.seconds if self.calls > 1 else 0.0))
