"""Ctrl-C and SIGTERM: the first one ends the work in order, a second one at once.

What the first one raises may be lost: libraries have handlers of any exception, and Python swallows
what is raised in callbacks. It is raised again, then, until somebody of ours has heard it.
"""

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

from mdpo_rddl.errors import interrupt_behind, is_heard

TERMINATED = 128 + signal.SIGTERM
"""The exit status that stands for SIGTERM."""
INTERRUPTED = 128 + signal.SIGINT
"""The exit status that stands for Ctrl-C."""

# GNU timeout, for one, sends two of them where one is meant
_SAME_SECONDS = 1.0
# after which what nobody has heard is raised again, and how often that is looked at
_AGAIN_SECONDS, _LOOK_SECONDS = 1.0, 0.25
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
      is_wanted: whether a signal has come.
      raised: what it has raised, and after it was lost what was raised again.
      raised_at: when, by `time.monotonic`.
      is_over: whether the block has ended.
    """

    status: int = INTERRUPTED
    is_wanted: bool = False
    raised: KeyboardInterrupt | None = None
    raised_at: float = 0.0
    is_over: bool = False

    def take(self, number: int) -> None:
        """A signal has come, for the first time or again.

        Raises:
          KeyboardInterrupt: if the block is to be ended, and does not end already.
        """
        if not self.is_wanted:
            self.is_wanted, self.status = True, 128 + number
        elif not self.is_lost:
            return
        if self.is_over or interrupt_behind(sys.exception()) is not None:
            return
        self.raised_at = time.monotonic()
        self.raised = Terminated() if self.status == TERMINATED else KeyboardInterrupt()
        raise self.raised

    @property
    def is_lost(self) -> bool:
        """Whether what was raised was heard by nobody for a while."""
        raised = self.raised
        if raised is None or is_heard(raised) or self.is_over:
            return False
        return time.monotonic() - self.raised_at > _AGAIN_SECONDS


@contextlib.contextmanager
def stopped_in_two_steps(name: str) -> Iterator[Stop]:
    """Raises in the block at the first signal; a later one ends the process.

    An error that a library has made of what was raised is that again outside of the block.

    Args:
      name: of the command, for what it says at its end.
    """
    stop = Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop  # where Python takes no signals
        return

    def handle(number: int, frame: Any) -> None:
        stop.take(number)

    plain_hook = sys.unraisablehook

    def without_ours(unraisable: Any) -> None:
        # what a callback has swallowed comes again
        if not (stop.is_wanted and isinstance(unraisable.exc_value, KeyboardInterrupt)):
            plain_hook(unraisable)

    before = {number: signal.signal(number, handle) for number in _SIGNALS}
    sys.unraisablehook = without_ours
    ours, theirs = socket.socketpair()
    theirs.setblocking(False)
    waker = signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)
    # the main thread may be computing, where Python runs no handlers
    watcher = threading.Thread(target=_watch, args=(ours, name, stop), daemon=True)
    watcher.start()
    try:
        yield stop
    except Exception as error:
        raised = interrupt_behind(error)
        if raised is None or raised is not stop.raised:
            raise
        raise raised from None
    finally:
        stop.is_over = True
        sys.unraisablehook = plain_hook
        signal.set_wakeup_fd(waker)
        theirs.close()
        watcher.join()
        for number, handler in before.items():
            signal.signal(number, handler)


def _watch(numbers: socket.socket, name: str, stop: Stop) -> None:
    """Reads the numbers of the signals as they come, until the other end is closed.

    The second one ends the process. The first one is sent to the main thread again as long as what
    it has raised there is lost.
    """
    first = asked = None
    is_ours = False
    with numbers:
        while True:
            try:
                received = numbers.recv(1)
            except TimeoutError:
                now = time.monotonic()
                if stop.is_lost and (asked is None or now - asked > _AGAIN_SECONDS):
                    asked, is_ours = now, True
                    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
                continue
            if not received:
                return
            number = received[0]
            if number not in _SIGNALS:
                continue
            if first is None:
                first = time.monotonic()
                numbers.settimeout(_LOOK_SECONDS)
            elif is_ours:
                is_ours = False
            elif time.monotonic() - first > _SAME_SECONDS:
                _end_now(number, name)


def _end_now(number: int, name: str) -> NoReturn:
    """Ends the process; its children see that, its lock is the system's to give back."""
    with contextlib.suppress(OSError):
        os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, _last_line(name))
    os._exit(128 + number)


def _last_line(name: str) -> bytes:
    return f"\n{name}: stopped at once; what was kept before stays\n".encode()
