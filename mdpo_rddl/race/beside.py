"""Work beside the race: in a process that this one forks, else in a thread.

A forked process begins within milliseconds with all that this one knows, and can be ended at any
time, whatever it does. Where there can be none (other systems than Linux, a daemonic process), a
thread shares the interpreter, and ends when it next asks for the time or sends something.
"""

import contextlib
import logging
import math
import multiprocessing
import os
import resource
import signal
import sys
import threading
import warnings
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from mdpo_rddl.errors import one_line_cause
from mdpo_rddl.machine.process_tree import address_space_bytes

logger = logging.getLogger(__name__)

Clock = Callable[[], float]
Work = Callable[[Callable[[Any], None], Clock], None]
"""Is given what sends a result, which must be picklable, and a clock, which says infinity once
nobody wants any more results."""


class EndedError(Exception):
    """The work has ended, and sends nothing more; says why, if it failed."""


class _Ended(NamedTuple):
    cause: str


class Beside:
    """Work that goes on beside, and what it sends."""

    def __init__(self, work: Work, clock: Clock, memory: int) -> None:
        """Begins the work.

        Args:
          work: see `Work`. What it changes is not seen here if it has a process of its own.
          clock: of the race.
          memory: bytes that a process may take beyond what this one has.
        """
        self._line, theirs = multiprocessing.Pipe(duplex=False)
        self._is_closed = threading.Event()
        self._process = _forked(work, theirs, clock, memory)
        if self._process is not None:
            theirs.close()
            return

        def told() -> float:
            return math.inf if self._is_closed.is_set() else clock()

        threading.Thread(target=_serve, args=(work, theirs, told), daemon=True).start()

    def has_news(self) -> bool:
        """Whether `receive` would not wait."""
        return self._line.poll()

    def receive(self) -> Any:
        """The next result.

        Raises:
          EndedError: if there is none any more.
        """
        try:
            news = self._line.recv()
        except (EOFError, OSError) as error:
            raise EndedError("its process was ended") from error
        if isinstance(news, _Ended):
            raise EndedError(news.cause)
        return news

    def close(self) -> None:
        """Ends the work; of what it sends nothing is received any more."""
        self._is_closed.set()
        if self._process is not None:
            self._process.kill()
            self._process.join()
        self._line.close()


def _forked(work: Work, line: Connection, clock: Clock, memory: int) -> Any:
    """A process that works; None where there can be none."""
    if sys.platform != "linux" or multiprocessing.current_process().daemon:
        return None
    process = multiprocessing.get_context("fork").Process(
        target=_in_process, args=(work, line, clock, memory, os.getpid()), daemon=True
    )
    try:
        with warnings.catch_warnings():
            # of JAX, if it was imported: it must not be used in a forked process, and is not
            warnings.simplefilter("ignore")
            process.start()
    except OSError as error:
        logger.info("no process beside: %s", one_line_cause(error))
        return None
    return process


def _in_process(work: Work, line: Connection, clock: Clock, memory: int, parent: int) -> None:
    """What the process does."""
    # the terminal's interrupt is for the parent, which ends us
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    limit = address_space_bytes() + memory
    most = resource.getrlimit(resource.RLIMIT_AS)[1]
    if most == resource.RLIM_INFINITY or limit < most:
        resource.setrlimit(resource.RLIMIT_AS, (limit, most))
    _serve(work, line, lambda: clock() if os.getppid() == parent else math.inf)


def _serve(work: Work, line: Connection, clock: Clock) -> None:
    """Works, and says how that has ended."""
    cause = ""
    try:
        work(line.send, clock)
    except Exception as error:  # the race goes on without it
        cause = one_line_cause(error)
    # nobody may listen any more
    with contextlib.suppress(OSError):
        line.send(_Ended(cause))
    line.close()
