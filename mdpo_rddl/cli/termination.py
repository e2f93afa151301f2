"""Ctrl-C and SIGTERM: the first one ends the work in order, a second one at once."""

import contextlib
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NoReturn

TERMINATED = 128 + signal.SIGTERM
"""The exit status that stands for SIGTERM."""
INTERRUPTED = 128 + signal.SIGINT
"""The exit status that stands for Ctrl-C."""

# GNU timeout, for one, sends two of them where one is meant
_SAME_SECONDS = 1.0
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Terminated(KeyboardInterrupt):
    """The process was asked to end by SIGTERM."""


def how_it_ended(stop: KeyboardInterrupt) -> str:
    """What happened, in a word."""
    return "terminated" if isinstance(stop, Terminated) else "interrupted"


def exit_status(stop: KeyboardInterrupt) -> int:
    """The exit status that stands for it."""
    return TERMINATED if isinstance(stop, Terminated) else INTERRUPTED


@dataclass
class Stop:
    """Whether a block was stopped.

    Attributes:
      status: the exit status that stands for how.
      is_wanted: whether a signal has come. What it raised may have been swallowed, as Python does
        in callbacks: whoever works on asks here.
    """

    status: int = INTERRUPTED
    is_wanted: bool = False


@contextlib.contextmanager
def stopped_in_two_steps(name: str) -> Iterator[Stop]:
    """Raises in the block at the first signal; a later one ends the process.

    Args:
      name: of the command, for what it says at its end.
    """
    stop = Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop  # where Python takes no signals
        return

    def handle(number: int, frame: Any) -> None:
        if stop.is_wanted:
            return
        stop.is_wanted, stop.status = True, 128 + number
        raise (Terminated if number == signal.SIGTERM else KeyboardInterrupt)

    plain_hook = sys.unraisablehook

    def without_ours(unraisable: Any) -> None:
        # what a callback has swallowed is not lost: `is_wanted` says it
        if not (stop.is_wanted and isinstance(unraisable.exc_value, KeyboardInterrupt)):
            plain_hook(unraisable)

    before = {number: signal.signal(number, handle) for number in _SIGNALS}
    sys.unraisablehook = without_ours
    ours, theirs = socket.socketpair()
    theirs.setblocking(False)
    waker = signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)
    # the main thread may be computing, where Python runs no handlers
    watcher = threading.Thread(target=_end_at_the_second, args=(ours, name), daemon=True)
    watcher.start()
    try:
        yield stop
    finally:
        sys.unraisablehook = plain_hook
        signal.set_wakeup_fd(waker)
        theirs.close()
        watcher.join()
        for number, handler in before.items():
            signal.signal(number, handler)


def _end_at_the_second(numbers: socket.socket, name: str) -> None:
    """Reads the numbers of the signals as they come, until the other end is closed."""
    first = None
    with numbers:
        while received := numbers.recv(1):
            number = received[0]
            if number not in _SIGNALS:
                continue
            if first is None:
                first = time.monotonic()
            elif time.monotonic() - first > _SAME_SECONDS:
                _end_now(number, name)


def _end_now(number: int, name: str) -> NoReturn:
    """Ends the process; its children see that, its lock is the system's to give back."""
    with contextlib.suppress(OSError):
        os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, _last_line(name))
    os._exit(128 + number)


def _last_line(name: str) -> bytes:
    return f"\n{name}: stopped at once; what was kept before stays\n".encode()
