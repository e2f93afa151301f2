"""The clock that everything in `auto` asks, and programs that are timed by it."""

import functools
import math
from collections.abc import Callable
from typing import Generic, ParamSpec, TypeVar

from mdpo_rddl.auto.common.compilations import TooLateError, compiled_within

Clock = Callable[[], float]
"""Seconds since some moment, as `time.monotonic` gives them."""

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def made_once(make: Callable[[], Callable[Arguments, Result]]) -> Callable[Arguments, Result]:
    """A function that is made where it is called first: a part of what `Timed` waits for."""
    made = functools.cache(make)
    return lambda *args, **kwargs: made()(*args, **kwargs)


class Timed(Generic[Arguments, Result]):
    """A compiled function that knows how long its calls take; the first one compiles it.

    Attributes:
      calls: number of calls so far.
      seconds: of the latest call.
    """

    def __init__(
        self, function: Callable[Arguments, Result], clock: Clock, deadline: float = math.inf
    ) -> None:
        """Calls nothing yet.

        Args:
          function: returns once it has computed its result.
          clock: what times it.
          deadline: until when the first call is waited for, by the clock.
        """
        self._function, self._clock, self._deadline = function, clock, deadline
        self._first_seconds = 0.0
        self.calls, self.seconds = 0, 0.0

    def __call__(self, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        """The function's result.

        Raises:
          TooLateError: if the deadline comes before the end of the first call.
        """
        started = self._clock()
        call = functools.partial(self._function, *args, **kwargs)
        try:
            result = call() if self.calls else compiled_within(self._deadline - started, call)
        except TooLateError:
            self._first_seconds = self._clock() - started
            raise
        self.seconds = self._clock() - started
        self._first_seconds = self._first_seconds if self.calls else self.seconds
        self.calls += 1
        return result

    @property
    def compile_seconds(self) -> float:
        """What the first call took longer than the latest; all of it if there was one only."""
        return max(0.0, self._first_seconds - (self.seconds if self.calls > 1 else 0.0))
