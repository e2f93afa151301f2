"""How much memory a process has had, and what happens if it becomes too much."""

import contextlib
import os
import resource
import sys
import threading
from collections.abc import Callable, Iterator

from mdpo_rddl.machine.process_tree import members, resident_bytes, shared_out_bytes

_POLL_SECONDS = 0.1
# looking for new processes takes longer than asking those that are known
_POLLS_TO_A_LOOK = 10


def peak_mb() -> float:
    """The largest resident memory that this process had up to now."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


@contextlib.contextmanager
def watched_memory(limit: float, exceeded: Callable[[float], None]) -> Iterator[None]:
    """Watches the memory of this process and all that it has started, ten times a second.

    Args:
      limit: resident memory in bytes; what processes share counts once. On Linux only, elsewhere
        nothing is watched.
      exceeded: called with the memory, in another thread, once it is over the limit.
    """
    done = threading.Event()

    def watch() -> None:
        polls, known = 0, {os.getpid()}
        while not done.wait(_POLL_SECONDS):
            if polls % _POLLS_TO_A_LOOK == 0:
                known = members(os.getpid())
            polls += 1
            resident = resident_bytes(known)
            if resident > limit and len(known) > 1:
                resident = shared_out_bytes(known)
            if resident > limit:
                exceeded(resident)
                return

    watcher = threading.Thread(target=watch, name="mdpo-rddl memory", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()
