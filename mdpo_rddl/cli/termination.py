"""SIGTERM as an exception, so that what was begun is cleared away."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from typing import Any, NoReturn

TERMINATED = 128 + signal.SIGTERM
"""The exit status that stands for it."""


class Terminated(BaseException):
    """The process was asked to end; like `KeyboardInterrupt`, nothing but the top handles it."""


@contextlib.contextmanager
def raised_on_sigterm() -> Iterator[None]:
    """Raises `Terminated` in the block at the first SIGTERM; the next ones are ignored.

    GNU timeout, for one, sends two: the second must not stop the clearing away.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # where Python takes no signals
        return

    def end(number: int, frame: Any) -> NoReturn:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        raise Terminated

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
