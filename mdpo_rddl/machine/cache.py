"""The folder in which programs are kept from one process to the next: where, how large."""

import contextlib
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mdpo_rddl.errors import InputError

MOST_BYTES = 2 * 2**30
"""That the folder holds once a command has begun."""

TRACED, TABLES = "traced", "grammar-tables"
"""The folder of traced programs in it, and the file of the grammar's tables."""

# JAX's, and ours
_PROGRAM = re.compile(rf".*-[0-9a-f]{{64}}-(cache|atime)|{TRACED}/(tmp\w+|[0-9a-f]{{64}})|{TABLES}")
_CACHE_VARIABLE = "JAX_COMPILATION_CACHE_DIR"


def cache_folder() -> Path:
    """Where programs are kept: in the user's cache folder, or where JAX was told to.

    Raises:
      InputError: if neither is known.
    """
    if folder := os.environ.get(_CACHE_VARIABLE):
        return Path(folder)
    try:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    except RuntimeError as error:  # the user has none
        raise InputError(f"no folder to keep programs in: set HOME or {_CACHE_VARIABLE}") from error
    return Path(base) / "mdpo-rddl" / "jax"


def grammar_tables() -> Path:
    """Where the tables of RDDL's grammar are kept, which take longer to build than to read."""
    return cache_folder() / TABLES


class CacheSize(NamedTuple):
    """What a folder holds.

    Attributes:
      files: their number.
      bytes: of all of them.
    """

    files: int
    bytes: int


def bound_cache(folder: Path, most_bytes: int = MOST_BYTES) -> CacheSize:
    """Removes what was not used for the longest time, until the rest is within the bound.

    Others may read and write there meanwhile: a program that is gone is compiled anew. What is
    not a program is left alone, wherever the user has put the cache.

    Returns:
      What was removed.
    """
    kept = removed = files = 0
    for _, size, path in sorted(_programs(folder), key=lambda entry: entry[0], reverse=True):
        if kept + size <= most_bytes:
            kept += size
        elif _is_removed(path):
            removed, files = removed + size, files + 1
    return CacheSize(files, removed)


def clear_cache(folder: Path) -> CacheSize:
    """Removes all programs.

    Returns:
      What was removed.
    """
    return bound_cache(folder, 0)


def _is_removed(path: Path) -> bool:
    with contextlib.suppress(OSError):  # somebody else's, or gone by now
        path.unlink()
        return True
    return False


def _programs(folder: Path) -> Iterator[tuple[float, int, Path]]:
    """Per file when it was last used, its size and its path."""
    for path in (*folder.glob("*"), *folder.glob(f"{TRACED}/*")):
        with contextlib.suppress(OSError):  # it is gone meanwhile
            if _PROGRAM.fullmatch(str(path.relative_to(folder))) and not path.is_dir():
                status = path.lstat()
                yield max(status.st_atime, status.st_mtime), status.st_size, path
