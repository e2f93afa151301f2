"""What may happen while modules are imported: signals, and variables that libraries refuse.

An import may swallow or change what a signal's handler raises.
"""

import contextlib
import os
import signal
import threading
import traceback
from collections.abc import Iterator
from types import FrameType
from typing import NoReturn

from mdpo_rddl.errors import InputError, one_line_cause


@contextlib.contextmanager
def ended_at_once() -> Iterator[None]:
    """Ctrl-C and SIGTERM in the block end the process, silently: nothing was begun yet.

    Raises:
      InputError: if a library refuses a variable of the environment, such as MPLBACKEND.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # where Python takes no signals
        return
    before = {each: signal.signal(each, _end) for each in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    except ValueError as error:
        if _is_ours(error):
            raise
        raise InputError(f"the environment: {one_line_cause(error)}") from error
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _is_ours(error: Exception) -> bool:
    """Whether it arose in this package."""
    *_, (frame, _line) = traceback.walk_tb(error.__traceback__)
    return str(frame.f_globals.get("__name__")).startswith(__name__.partition(".")[0])


def _end(number: int, frame: FrameType | None) -> NoReturn:
    os._exit(128 + number)
