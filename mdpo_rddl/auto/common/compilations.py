"""The programs that arms need, compiled one after the other while the arms work."""

import threading
import time
from collections.abc import Callable
from typing import TypeVar

from mdpo_rddl.machine.background import Background
from mdpo_rddl.machine.device import as_here

Result = TypeVar("Result")


class TooLateError(Exception):
    """A program was not compiled: there would have been too little time left to use it."""


def compiled_within(seconds: float, call: Callable[[], Result]) -> Result:
    """The result of a call that compiles a program, which nothing interrupts: it has a thread.

    Args:
      seconds: how long it is waited for; not begun if there are none.
      call: must not ask the clock, which may raise for the caller only.

    Raises:
      TooLateError: if it takes longer, and goes on for nobody.
      KeyboardInterrupt: if interrupted, and it goes on likewise.
      Exception: whatever the call has raised.
    """
    results: list[Result] = []
    if seconds > 0.0:
        work = Background(as_here(lambda: results.append(call())))
        if work.wait(time.monotonic() + seconds):
            return results[0]
    raise TooLateError("the time was over before a program was compiled")


class Compilations:
    """Each program waits for the one before it: side by side, all of them would come late.

    Nothing interrupts a compilation, and the process waits at its end for one that has begun. So
    none begins where too little time is left, or once the race is over.
    """

    def __init__(self) -> None:
        """Compiles nothing yet."""
        self._last: Background | None = None
        self._closed = threading.Event()

    def add(self, compile_program: Callable[[], None], seconds: float) -> Background:
        """Compiles a program after those before it.

        Args:
          compile_program: does it.
          seconds: after which it does not begin any more; waiting for it raises `TooLateError`
            then.
        """
        before, latest = self._last, time.monotonic() + seconds

        def in_turn() -> None:
            if before is not None:
                before.join()
            if self._closed.is_set() or time.monotonic() > latest:
                raise TooLateError("too little time was left to compile it")
            compile_program()

        self._last = Background(as_here(in_turn))
        return self._last

    def close(self) -> None:
        """Lets no other compilation begin."""
        self._closed.set()
