"""Work in a process of its own, within a time and a memory: however it ends, we go on."""

import resource
import time
from collections.abc import Callable, Generator, Sequence
from typing import Any, NamedTuple

from mdpo_rddl.machine.child import Child, ChildEndedError
from mdpo_rddl.machine.messages import Messages, packed, unpacked
from mdpo_rddl.machine.process_tree import members, resident_bytes, shared_out_bytes

_POLL_SECONDS = 0.1
# looking through all processes takes longer than asking those that are known
_MEMBERS_SECONDS = 0.5
_MB = 2**20
_START_SECONDS = 300.0
# of the child and of what it starts: a file's size, and how many they may be
_MOST_FILE_BYTES = 2**31
_MOST_PROCESSES = 1000


class Limits(NamedTuple):
    """What one item of work may use.

    Attributes:
      seconds: from the end of the one before it; the process's start is not counted.
      memory_gb: resident memory of the process and all that it has started, in 1e9 bytes; on
        Linux only, elsewhere there is no limit.
    """

    seconds: float
    memory_gb: float


class ProcessFailure(NamedTuple):
    """An end without a result.

    Attributes:
      status: "timeout", "memory" or "crash"; the latter also for a process that sends what is no
        answer, or starts more than a thousand others.
      cause: one line.
      seconds: since the item was begun.
      peak_mb: largest resident memory seen, of the process and all that it has started, in
        2**20 bytes.
    """

    status: str
    cause: str
    seconds: float
    peak_mb: float


def run_guarded(
    work: Callable[[Any], dict[str, Any]],
    items: Sequence[Any],
    limits: Limits | Callable[[Any], Limits],
) -> Generator[tuple[Any, dict[str, Any] | ProcessFailure], None, None]:
    """Works on the items in turn, all in one fresh process, and in another after a failure.

    The process, and whatever it has started, ends with the iteration. Who leaves that before
    its end closes it.

    Args:
      work: a function at the top of a module, or a picklable object that can be called, which
        may keep things from one item to the next; its result is a dictionary that JSON can hold.
      items: what to call it with.
      limits: for each item, or a function that tells an item's.

    Yields:
      Each item with its result as soon as it is there, or with the failure of its process.
    """
    left = list(items)
    while left:
        with Child(serve) as child:
            worker = _Worker(child, work)
            while left:
                limit = limits if isinstance(limits, Limits) else limits(left[0])
                outcome = worker.result(left[0], limit)
                yield left.pop(0), outcome
                if isinstance(outcome, ProcessFailure):
                    break


class _Worker:
    """A child that works on one item after the other, watched.

    Questions and their answers are numbered: what has been answered once is not answered again.
    """

    def __init__(self, child: Child, work: Callable[[Any], dict[str, Any]]) -> None:
        self._child, self._work = child, work
        self._is_ready, self._number = False, 0
        self._members: set[int] = set()
        self._listed = -_MEMBERS_SECONDS

    def result(self, item: Any, limits: Limits) -> dict[str, Any] | ProcessFailure:
        if not self._is_ready:
            starting = limits._replace(seconds=max(limits.seconds, _START_SECONDS))
            answer = self._answer(self._work, starting)
            if isinstance(answer, ProcessFailure):
                return answer
            self._is_ready = True
        return self._answer(item, limits)

    def _answer(self, question: Any, limits: Limits) -> dict[str, Any] | ProcessFailure:
        started, peak = time.monotonic(), 0.0
        self._number += 1
        try:
            self._child.ask([self._number, packed(question)])
            while True:
                if (answer := self._received()) is not None:
                    return answer
                resident = self._resident_bytes(limits.memory_gb * 1e9)
                seconds, peak = time.monotonic() - started, max(peak, resident / _MB)
                if resident > limits.memory_gb * 1e9:
                    return ProcessFailure("memory", f"over {limits.memory_gb:g} GB", seconds, peak)
                if seconds > limits.seconds:
                    return ProcessFailure("timeout", f"over {limits.seconds:g} s", seconds, peak)
                if len(self._members) > _MOST_PROCESSES:
                    raise ChildEndedError(f"over {_MOST_PROCESSES} processes")
        except ChildEndedError as error:
            return ProcessFailure("crash", str(error), time.monotonic() - started, peak)

    def _received(self) -> dict[str, Any] | None:
        """The answer to the last question; None if it is not there yet."""
        try:
            answer = self._child.answer(_POLL_SECONDS)
        except TimeoutError:
            return None
        match answer:
            case [int(number), dict(result)] if number == self._number:
                return result
            case [int(number), dict()] if 0 < number < self._number:
                return None  # repeated
        raise ChildEndedError("it sent what is no answer")

    def _resident_bytes(self, limit: float) -> int:
        """Resident memory of the child and all that it has started."""
        now = time.monotonic()
        if now - self._listed >= _MEMBERS_SECONDS:
            self._members, self._listed = members(self._child.pid), now
        resident = resident_bytes(self._members)
        if resident > limit and len(self._members) > 1:
            return shared_out_bytes(self._members)  # forked processes share most of theirs
        return resident


def serve(messages: Messages) -> None:
    """The child: reads the work, and then an item at a time, until it is ended."""
    _bound_files()
    number, packed = messages.receive()
    work = unpacked(packed)
    messages.send([number, {}])
    while True:
        number, packed = messages.receive()
        messages.send([number, work(unpacked(packed))])


def _bound_files() -> None:
    """Has no file grow without end, or it would fill the disk."""
    given = resource.getrlimit(resource.RLIMIT_FSIZE)
    least = min((_MOST_FILE_BYTES, *(each for each in given if each != resource.RLIM_INFINITY)))
    resource.setrlimit(resource.RLIMIT_FSIZE, (least, least))
