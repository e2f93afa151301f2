"""Work that cannot be interrupted, such as compilation, kept from exceeding a deadline."""

import contextlib
import threading
import time
from collections.abc import Callable

from mdpo_rddl.errors import Cancelled

_SLICE_SECONDS = 0.1
# after an interrupt, for what has been found so far
_GRACE_SECONDS = 3.0


class Work:
    """What the work may ask about itself.

    Attributes:
      is_abandoned: whether nobody waits for it any more: it must not touch what others use.
    """

    def __init__(self) -> None:
        self.is_abandoned = False
        self._is_cancelled = False

    def raise_if_cancelled(self) -> None:
        """Called by the work now and then.

        Raises:
          Cancelled: if it should end.
        """
        if self._is_cancelled or self.is_abandoned:
            raise Cancelled

    def cancel(self) -> None:
        """Lets the next `raise_if_cancelled` raise."""
        self._is_cancelled = True


def run_until(task: Callable[[Work], None], until: float) -> bool:
    """Runs a task in a thread of its own and waits for it, but no longer than that.

    An interrupt cancels the task, which has a moment to end. A task that is abandoned ends at
    its next `Work.raise_if_cancelled`; the process waits for it when it exits.

    Args:
      task: is given a `Work`.
      until: when to abandon it, by `time.monotonic`.

    Returns:
      Whether it ended in time.

    Raises:
      KeyboardInterrupt: if interrupted.
      Exception: whatever the task raises in time.
    """
    work, done = Work(), threading.Event()
    raised: list[BaseException] = []

    def run() -> None:
        try:
            task(work)
        except BaseException as error:  # raised where the task is waited for
            raised.append(error)
        finally:
            done.set()

    thread = threading.Thread(target=run, name="mdpo-rddl work")
    thread.start()
    try:
        _wait(done, until)
    except KeyboardInterrupt:
        work.cancel()
        with contextlib.suppress(KeyboardInterrupt):
            _wait(done, time.monotonic() + _GRACE_SECONDS)
        raise
    finally:
        ended = done.is_set()
        work.is_abandoned = not ended
    if ended and raised:
        raise raised[0]
    return ended


def _wait(done: threading.Event, until: float) -> None:
    # no `Thread.join`: one that is interrupted takes a running thread for ended
    while not done.is_set() and (left := until - time.monotonic()) > 0:
        done.wait(min(left, _SLICE_SECONDS))
