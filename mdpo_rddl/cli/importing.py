"""Signals while modules are imported, which may swallow or change what a handler raises."""

import contextlib
import os
import signal
import threading
from collections.abc import Iterator
from types import FrameType
from typing import NoReturn


@contextlib.contextmanager
def ended_at_once() -> Iterator[None]:
    """Ctrl-C and SIGTERM in the block end the process, silently: nothing was begun yet."""
    if threading.current_thread() is not threading.main_thread():
        yield  # where Python takes no signals
        return
    before = {each: signal.signal(each, _end) for each in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _end(number: int, frame: FrameType | None) -> NoReturn:
    os._exit(128 + number)
