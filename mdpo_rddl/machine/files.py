"""Files that are there as a whole or not at all."""

import os
import tempfile
from pathlib import Path

from mdpo_rddl.errors import InputError


def write_atomically(path: Path, content: bytes | str) -> None:
    """Writes a file in one step, so that nobody sees half of it, whenever we are killed.

    Its folder is made if missing.

    Raises:
      InputError: naming the file, if it cannot be written.
    """
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException as error:
        if temporary is not None and os.path.exists(temporary):
            os.unlink(temporary)
        if isinstance(error, OSError):
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
        raise
