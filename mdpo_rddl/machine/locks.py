"""A lock on a folder, which a process that has ended does not hold, however it ended."""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from mdpo_rddl.errors import InputError

RESULTS_LOCK = ".lock"
"""The name of the lock in a folder of results."""


class FolderLock:
    """The right to write into a folder; a context manager that gives it back.

    The system gives the lock back with the process, so a file that is left behind means nothing.
    """

    def __init__(self, path: Path, what: str) -> None:
        """Takes the lock.

        Args:
          path: of the file that is locked; made if missing, in a folder that is there.
          what: is locked, for the message.

        Raises:
          InputError: if another process, or another run of this one, has it.
          OSError: if the file cannot be made.
        """
        self.path = path
        self._handle = -1
        while self._handle < 0:
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
            try:
                self._take(handle, what)
            except BaseException:
                os.close(handle)
                raise
            if _is_still(path, handle):
                self._handle = handle
            else:  # whoever had it has removed the file meanwhile
                os.close(handle)
        os.ftruncate(self._handle, 0)
        os.pwrite(self._handle, f"{os.getpid()}\n".encode(), 0)

    def __enter__(self) -> "FolderLock":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.release()

    def release(self) -> None:
        """Removes the file and gives the lock back."""
        if self._handle < 0:
            return
        with contextlib.suppress(OSError):
            if _is_still(self.path, self._handle):
                os.unlink(self.path)
        os.close(self._handle)
        self._handle = -1

    @staticmethod
    def _take(handle: int, what: str) -> None:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            owner = os.pread(handle, 20, 0).decode(errors="replace").strip()
            by = f"process {owner}" if owner.isdecimal() else "another process"
            raise InputError(f"{what}: already in use by {by}") from error


@contextlib.contextmanager
def locked_results(root: Path) -> Iterator[None]:
    """Holds the lock of a folder of results, made if missing and removed if it stays empty.

    So are the folders on the way to it.

    Raises:
      InputError: if another process has it, or the folder cannot be written.
    """
    made = [folder for folder in (root, *root.parents) if not os.path.lexists(folder)]
    try:
        try:
            root.mkdir(parents=True, exist_ok=True)
            lock = FolderLock(root / RESULTS_LOCK, str(root))
        except OSError as error:
            raise InputError(f"{root}: cannot be written: {error.strerror}") from error
        with lock:
            yield
    finally:
        for folder in made:
            with contextlib.suppress(OSError):  # it is not empty, or was not made
                folder.rmdir()


def _is_still(path: Path, handle: int) -> bool:
    """Whether a path is the file that is open."""
    try:
        return os.path.samestat(os.stat(path, follow_symlinks=False), os.fstat(handle))
    except OSError:
        return False
