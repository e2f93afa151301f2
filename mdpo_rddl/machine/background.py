"""Work that cannot be interrupted, such as compilation, kept from exceeding a deadline."""

import threading
import time
from collections.abc import Callable

_SLICE_SECONDS = 0.1
_NAME = "mdpo-rddl work"


def is_at_work() -> bool:
    """Whether some work goes on that nobody need be waiting for any more."""
    return any(thread.name == _NAME for thread in threading.enumerate())


class Background:
    """Work in a thread of its own, which whoever started it waits for now and then.

    Nothing ends it; the process waits for it when it exits.
    """

    def __init__(self, task: Callable[[], None]) -> None:
        """Starts the task."""
        self._task, self._done = task, threading.Event()
        self._raised: list[BaseException] = []
        # said, since a thread inherits it: a daemon that the end of Python meets in XLA aborts it
        threading.Thread(target=self._run, name=_NAME, daemon=False).start()

    def _run(self) -> None:
        try:
            self._task()
        except BaseException as error:  # raised where the task is waited for
            self._raised.append(error)
        finally:
            self._done.set()

    @property
    def has_ended(self) -> bool:
        """Whether the task is done, or has raised something."""
        return self._done.is_set()

    def join(self) -> None:
        """Waits for the end of the task, whatever it has raised."""
        self._done.wait()

    def wait(self, until: float) -> bool:
        """Waits for the task.

        Args:
          until: how long, by `time.monotonic`.

        Returns:
          Whether it has ended.

        Raises:
          KeyboardInterrupt: if interrupted; the task goes on.
          Exception: whatever the task has raised.
        """
        # no `Thread.join`: one that is interrupted takes a running thread for ended
        while not self._done.is_set() and (left := until - time.monotonic()) > 0:
            self._done.wait(min(left, _SLICE_SECONDS))
        if self._done.is_set() and self._raised:
            raise self._raised[0]
        return self._done.is_set()
