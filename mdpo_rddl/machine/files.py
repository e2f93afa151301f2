"""Files that are there as a whole or not at all, and files that anybody may have written."""

import contextlib
import errno
import json
import math
import os
import re
import stat
import tempfile
from pathlib import Path
from typing import Any

from mdpo_rddl.errors import InputError

# as `tempfile` makes them
_TEMPORARY = re.compile(r"\..+-[a-z0-9_]{8}")

MOST_BYTES = 2**26
"""Of a file of results."""


def read_bounded(path: Path, most_bytes: int, within: Path | None = None) -> bytes:
    """Reads a regular file of a bounded size: no device, no pipe, whatever its name says.

    Args:
      path: of the file.
      most_bytes: that it may hold.
      within: a folder that links must not lead out of, if any.

    Raises:
      InputError: naming the file, if it is no regular file, too large or outside of the folder.
      OSError: if it cannot be read.
    """
    # a pipe without a writer would be waited for
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(handle, "rb") as file:
        status = os.fstat(handle)
        if stat.S_ISDIR(status.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if not stat.S_ISREG(status.st_mode):
            raise InputError(f"{path}: is not a regular file")
        if within is not None and not path.resolve().is_relative_to(within.resolve()):
            raise InputError(f"{path}: is a link that leads out of {within}")
        # a file may be larger than it says, or grow meanwhile
        content = b"" if status.st_size > most_bytes else file.read(most_bytes + 1)
        if content is None:  # a file of the system's that has nothing to say yet
            raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
        if max(status.st_size, len(content)) > most_bytes:
            raise InputError(f"{path}: is larger than {size_text(most_bytes)}, the most to be read")
        return content


def decoded(content: bytes, errors: str = "strict") -> str:
    """The text of a file in UTF-8, with Unix line ends and without byte order marks.

    Args:
      content: of the file.
      errors: as `bytes.decode` takes it.
    """
    # an editor may have put a second mark before one that it did not know
    text = content.decode("utf-8", errors).lstrip("\ufeff")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_json(path: Path, within: Path | None = None) -> Any:
    """Reads what `json` makes of a file of at most `MOST_BYTES`, as `read_bounded` reads it.

    Raises:
      ValueError: if it is not JSON, or nested too deeply.
      InputError, OSError: as `read_bounded` does.
    """
    try:
        return json.loads(read_bounded(path, MOST_BYTES, within))
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def finite_or_none(value: float | None) -> float | None:
    """None for what JSON has no number for."""
    return value if value is not None and math.isfinite(value) else None


def size_text(count: int) -> str:
    """A number of bytes, in words."""
    return f"{count / 2**20:,.0f} MiB" if count >= 2**20 else f"{count:,} bytes"


def write_atomically(path: Path, content: bytes | str) -> None:
    """Writes a file in one step, so that nobody sees half of it, whenever we are killed.

    Its folder is made if missing. The content is on the disk before it takes the name. A link is
    replaced, not what it leads to.

    Raises:
      InputError: naming the file, if it cannot be written, or the name is that of a device, a pipe
        or a socket, which it would take.
    """
    temporary = None
    try:
        _refuse_special(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(handle)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
        sync_folder(path.parent)
    except BaseException as error:
        if temporary is not None:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
        if isinstance(error, OSError):
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
        raise


def _refuse_special(path: Path) -> None:
    with contextlib.suppress(FileNotFoundError):
        mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise InputError(f"{path}: cannot be written: is not a regular file")


def is_temporary(name: str) -> bool:
    """Whether a file's name is one that `write_atomically` uses until it is done or killed."""
    return _TEMPORARY.fullmatch(name) is not None


def append(path: Path, content: bytes) -> None:
    """Adds to the end of a file, all of it or nothing.

    Raises:
      InputError: naming the file, if it cannot be written.
    """
    try:
        with path.open("r+b", buffering=0) as file:
            before = file.seek(0, os.SEEK_END)
            try:
                left = memoryview(content)
                while left:
                    left = left[file.write(left) :]
                os.fsync(file.fileno())
            except BaseException:
                file.truncate(before)
                raise
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def sync_folder(folder: Path) -> None:
    """Puts the names in a folder on the disk, where the file system can do that."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
