"""Files that are there as a whole or not at all."""

import os
from pathlib import Path

from mdpo_rddl.errors import InputError


def write_whole(path: Path, content: str | bytes) -> None:
    """Writes a file under another name and gives it its own in one step; makes its folder.

    Raises:
      InputError: if it cannot be written.
    """
    data = content.encode() if isinstance(content, str) else content
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            beside.write_bytes(data)
            os.replace(beside, path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
