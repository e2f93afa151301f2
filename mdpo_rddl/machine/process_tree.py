"""A process with everything that it has started: who belongs to it, its memory, its end.

Linux tells all of it by `/proc`. Elsewhere only the process group is known, and no memory.
"""

import contextlib
import ctypes
import os
import signal
from collections.abc import Iterable
from pathlib import Path

_PROC = Path("/proc")
_SET_CHILD_SUBREAPER = 36
_PPID, _SESSION = 1, 3  # fields of `stat` after the name in parentheses


def adopt_orphans() -> None:
    """Makes this process the parent of all descendants whose parents end, where Linux can."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def members(leader: int) -> set[int]:
    """The leader of a session, all of that session, and the descendants of them all.

    A descendant in a session of its own is found by its parents. One whose parents are gone is
    found if it has stayed in a session that is known, or the leader adopts orphans.

    Args:
      leader: a process that leads a session.

    Returns:
      Process numbers, the leader's among them even if it has ended.
    """
    found = {leader}
    children: dict[int, set[int]] = {}
    for entry in _PROC.glob("[0-9]*"):
        with contextlib.suppress(OSError, IndexError):  # it has ended meanwhile
            fields = (entry / "stat").read_text(errors="replace").rpartition(")")[2].split()
            number = int(entry.name)
            children.setdefault(int(fields[_PPID]), set()).add(number)
            if int(fields[_SESSION]) == leader:
                found.add(number)
    new = set(found)
    while new:
        new = set().union(*(children.get(number, set()) for number in new)) - found
        found |= new
    return found


def resident_bytes(processes: Iterable[int]) -> int:
    """Resident memory; what several share counts in each. 0 where it is not known."""
    total = 0
    for number in processes:
        with contextlib.suppress(OSError, IndexError):
            total += int((_PROC / str(number) / "statm").read_text().split()[1])
    return total * os.sysconf("SC_PAGE_SIZE")


def address_space_bytes() -> int:
    """The address space of this process, on Linux."""
    pages = int((_PROC / "self" / "statm").read_text().split()[0])
    return pages * os.sysconf("SC_PAGE_SIZE")


def shared_out_bytes(processes: Iterable[int]) -> int:
    """Resident memory; what several share is divided among them. Takes longer to find out."""
    total = 0
    for number in processes:
        try:
            lines = (_PROC / str(number) / "smaps_rollup").read_text().splitlines()
            total += sum(int(line.split()[1]) for line in lines if line.startswith("Pss:")) * 1024
        except OSError:  # an old kernel, or a process of somebody else
            total += resident_bytes([number])
    return total


def end_tree(leader: int) -> None:
    """Kills the leader of a session and everything that it has started.

    Args:
      leader: a process that leads a session, and has not been waited for.
    """
    if leader != os.getpid():
        _signal(leader, signal.SIGSTOP)  # it starts no other one meanwhile
    end_started(leader)
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(leader, signal.SIGKILL)
    _signal(leader, signal.SIGKILL)


def end_started(leader: int) -> None:
    """Kills everything that the leader of a session has started."""
    stopped = {leader}
    while new := members(leader) - stopped:
        for number in new:
            _signal(number, signal.SIGSTOP)
        stopped |= new
    for number in stopped - {leader}:
        _signal(number, signal.SIGKILL)


def _signal(number: int, what: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.kill(number, what)
