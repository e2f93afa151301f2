"""Work for a process of its own that ends badly; imported by the child too."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from benchmarks.problems.attempts import Attempt


def in_this_process(work: Callable[[Any], Any], items: Sequence[Any], limits: Any) -> Iterator[Any]:
    """Stands for `run_guarded` where nothing fails."""
    for item in items:
        yield item, work(item)


ROW = {"status": "ok", "cause": "", "horizon": 5, "seconds": 0.1, "peak_mb": 100}


def fate(attempt: Attempt) -> dict[str, Any]:
    """Ends as the planner's name says."""
    if attempt.planner == "crash":
        os.write(2, b"check failed:\n  no such kernel\n")
        os.kill(os.getpid(), signal.SIGABRT)
    if attempt.planner == "exit":
        os._exit(3)
    if attempt.planner == "hang":
        time.sleep(600)
    if attempt.planner == "hungry":
        hoard = [bytearray(b"x" * 2**25) for _ in range(60)]  # 2 GB
        time.sleep(600)
        del hoard
    os.write(1, b"noise on standard output\n")
    return {**ROW, "return": float(os.getpid())}


class Counting:
    """Counts its calls; some of them do more."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, item: str) -> dict[str, Any]:
        self.count += 1
        child = None
        if item == "hang":
            time.sleep(600)
        if item == "signals":
            for number in (signal.SIGTERM, signal.SIGUSR2):
                os.kill(os.getpid(), number)
            process = subprocess.Popen(["sleep", "600"])
            process.terminate()
            child = process.wait(10)
        return {"count": self.count, "child": child}


_HOARD = "import time; hoard = b'x' * 10**9; time.sleep(600)"


def spread(item: str) -> dict[str, Any]:
    """Uses memory in processes that it starts."""
    if item == "hoarding child":
        subprocess.run([sys.executable, "-c", _HOARD], start_new_session=True, check=False)
    if item == "sharing children":
        hoard = bytearray(b"x" * (3 * 10**8))
        forked = []
        for _ in range(4):
            number = os.fork()
            if number == 0:
                time.sleep(600)
            forked.append(number)
        time.sleep(3.0)
        for number in forked:
            os.kill(number, signal.SIGKILL)
            os.waitpid(number, 0)
        return {"bytes": len(hoard)}
    return {}


class Starting:
    """Starts a process in a session of its own, and leaves it."""

    def __call__(self, item: str) -> dict[str, Any]:
        process = subprocess.Popen(["sleep", "600"], start_new_session=True)
        return {"child": process.pid, "worker": os.getpid()}
