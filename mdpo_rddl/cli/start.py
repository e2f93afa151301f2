"""Where the commands begin: Ctrl-C ends them quietly before their imports are done.

The modules of the commands are imported where each begins, so that hardly anything comes before.
"""

# PYTHON_ARGCOMPLETE_OK

import contextlib
import os
import signal
from collections.abc import Iterator
from types import FrameType
from typing import NoReturn

_INTERRUPTED = 128 + signal.SIGINT


def plan() -> int:
    """`mdpo-plan`."""
    with _quiet():
        from mdpo_rddl.cli.plan import main
    return main()


def bench() -> int:
    """`mdpo-bench`."""
    with _quiet():
        from mdpo_rddl.cli.bench import main
    return main()


def ipc() -> int:
    """`mdpo-ipc`."""
    with _quiet():
        from mdpo_rddl.cli.ipc import main
    return main()


def report() -> int:
    """`mdpo-report`."""
    with _quiet():
        from mdpo_rddl.cli.report import main
    return main()


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    # what Ctrl-C raises while a module is imported, the module may swallow or change
    before = signal.signal(signal.SIGINT, _end)
    yield
    signal.signal(signal.SIGINT, before)


def _end(number: int, frame: FrameType | None) -> NoReturn:
    os._exit(_INTERRUPTED)
