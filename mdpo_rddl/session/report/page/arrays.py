"""Arrays from a `.npz` file that anybody may have written."""

import io
import math
import tokenize
import zipfile
import zlib
from pathlib import Path

import numpy as np

from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.machine.files import read_bounded, size_text

_MOST_BYTES, _MOST_UNPACKED_BYTES = 2**26, 2**29
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
# what the packages say of an archive or a header that they cannot read
_DAMAGES = (
    OSError,
    OverflowError,
    ValueError,
    TypeError,
    EOFError,
    SyntaxError,
    MemoryError,
    RecursionError,
    NotImplementedError,
    RuntimeError,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """All arrays of a file, by their names, none larger than the bytes that are there for it.

    Raises:
      InputError: naming the file, if it is damaged, too large or a link that leads elsewhere.
    """
    try:
        content = io.BytesIO(read_bounded(path, _MOST_BYTES, path.parent))
        with zipfile.ZipFile(content) as packed:
            unpacked = sum(member.file_size for member in packed.infolist())
            if unpacked > _MOST_UNPACKED_BYTES:
                size = size_text(unpacked)
                raise InputError(f"{path}: would unpack to {size}, which is too much")
            members = packed.infolist()
            return {m.filename.removesuffix(".npy"): _array(packed.read(m)) for m in members}
    except _DAMAGES as error:
        raise InputError(f"{path}: damaged: {one_line_cause(error)}") from error


def _array(content: bytes) -> np.ndarray:
    """The array of an `.npy` file.

    Raises:
      ValueError: if its shape is not that of its bytes, before room is made for it.
    """
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)
    if version not in _HEADERS:
        raise ValueError(f"an array of version {version}")
    shape, _, kind = _HEADERS[version](file)
    if kind.hasobject:
        raise ValueError("an array of objects")
    left = len(content) - file.tell()
    # values of no bytes, and those of an empty array, could be of any number
    is_bounded = kind.itemsize > 0 and max(shape, default=0) <= _MOST_UNPACKED_BYTES
    is_whole = min(shape, default=0) >= 0 and math.prod(shape) * kind.itemsize == left
    if not (is_bounded and is_whole):
        raise ValueError(f"an array of shape {shape} in {left:,} bytes")
    file.seek(0)
    return np.lib.format.read_array(file, allow_pickle=False)
