"""Work in a process of its own, within a time and a memory: however it ends, we go on."""

import contextlib
import json
import multiprocessing
import os
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from mdpo_rddl.machine.child import end_with

_POLL_SECONDS = 0.1
_MB = 2**20
_READY = b"ready"
_START_SECONDS = 300.0


class Limits(NamedTuple):
    """What one item of work may use.

    Attributes:
      seconds: from the end of the one before it; the process's start is not counted.
      memory_gb: resident memory of the process; on Linux only, elsewhere there is no limit.
    """

    seconds: float
    memory_gb: float


class Death(NamedTuple):
    """An end without a result.

    Attributes:
      status: "timeout", "memory" or "crash".
      cause: one line.
      seconds: since the item was begun.
      peak_mb: largest resident memory seen.
    """

    status: str
    cause: str
    seconds: float
    peak_mb: float


def run_guarded(
    work: Callable[[Any], dict[str, Any]],
    items: Sequence[Any],
    limits: Limits | Callable[[Any], Limits],
) -> Generator[tuple[Any, dict[str, Any] | Death], None, None]:
    """Works on the items in turn, all in one fresh process, and in another after a death.

    The process, and whatever it has started, ends with the iteration. Who leaves that before
    its end closes it.

    Args:
      work: a function at the top of a module, or a picklable object that can be called, which
        may keep things from one item to the next; its result is anything that JSON can hold.
      items: what to call it with.
      limits: for each item, or a function that tells an item's.

    Yields:
      Each item with its result as soon as it is there, or with the death of its process.
    """
    left = list(items)
    while left:
        with _Process(work, left) as process:
            while left:
                limit = limits if isinstance(limits, Limits) else limits(left[0])
                outcome = process.next_result(limit)
                yield left.pop(0), outcome
                if isinstance(outcome, Death):
                    break


class _Process:
    """A child that works on items and sends the results, one by one."""

    def __init__(self, work: Callable[[Any], dict[str, Any]], items: Sequence[Any]) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="mdpo-worker-")
        self._log = Path(self._folder.name) / "log"
        context = multiprocessing.get_context("spawn")
        self._results, sender = context.Pipe(duplex=False)
        arguments = (work, list(items), sender, str(self._log))
        # not a daemon: the work may start processes of its own
        self._process = context.Process(target=_serve, args=arguments)
        self._is_ready = False
        self._process.start()
        sender.close()  # so that the child's death is the end of the pipe

    def __enter__(self) -> "_Process":
        return self

    def __exit__(self, *error: object) -> None:
        if self._is_ready and self._process.pid is not None:  # it leads a group by then
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
        self._process.kill()
        self._process.join()
        self._results.close()
        self._folder.cleanup()

    def next_result(self, limits: Limits) -> dict[str, Any] | Death:
        if not self._is_ready:
            starting = limits._replace(seconds=max(limits.seconds, _START_SECONDS))
            message = self._receive(starting)
            if isinstance(message, Death):
                return message
            self._is_ready = True
        message = self._receive(limits)
        return message if isinstance(message, Death) else json.loads(message)

    def _receive(self, limits: Limits) -> bytes | Death:
        started, peak = time.monotonic(), 0.0
        while True:
            is_there = self._results.poll(_POLL_SECONDS)
            seconds = time.monotonic() - started
            if is_there:
                try:
                    return self._results.recv_bytes()
                except EOFError:
                    return Death("crash", self._last_words(), seconds, peak)
            peak = max(peak, self._resident_mb())
            if peak * _MB > limits.memory_gb * 1e9:
                return Death("memory", f"over {limits.memory_gb:g} GB", seconds, peak)
            if seconds > limits.seconds:
                return Death("timeout", f"over {limits.seconds:g} s", seconds, peak)

    def _resident_mb(self) -> float:
        try:
            pages = int(Path(f"/proc/{self._process.pid}/statm").read_text().split()[1])
        except (OSError, IndexError):
            return 0.0
        return pages * os.sysconf("SC_PAGE_SIZE") / _MB

    def _last_words(self) -> str:
        self._process.join()
        code = self._process.exitcode or 0
        end = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit status {code}"
        try:
            said = self._log.read_text(encoding="utf-8", errors="replace").split("\n")
        except OSError:
            said = []
        lines = [" ".join(line.split()) for line in said if line.strip()]
        return f"{end}: {lines[-1]}" if lines else end


def _ignore(number: int, frame: Any) -> None:
    """Leaves a signal to the parent; unlike `SIG_IGN`, no program that we start inherits it."""


def _serve(work: Callable[[Any], dict[str, Any]], items: list[Any], sender: Any, log: str) -> None:
    os.setsid()  # whatever the work starts ends with us
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends us
    # a cluster that wants the machine back signals us too; what the work starts stays killable
    for number in (signal.SIGTERM, signal.SIGUSR2):
        signal.signal(number, _ignore)
        os.register_at_fork(after_in_child=partial(signal.signal, number, signal.SIG_DFL))
    threading.Thread(target=end_with, args=(os.getppid(),), daemon=True).start()
    # what native code prints is all that a crash leaves behind
    file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    os.dup2(file, 1)
    os.dup2(file, 2)
    sender.send_bytes(_READY)
    for item in items:
        sender.send_bytes(json.dumps(work(item)).encode())
    sender.close()
