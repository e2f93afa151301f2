"""Tensors and text in one safetensors file with a digest: nothing in it executes."""

import hashlib
import json
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
from safetensors.numpy import load, save

from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.machine.files import read_bounded, write_atomically

MOST_POLICY_BYTES = 2**29
"""Of a file; its tensors take as many bytes as they have in it."""

_LENGTH_BYTES, _MOST_HEADER_BYTES, _ALIGNMENT = 8, 2**26, 8

Tensors = dict[str, np.ndarray]
Metadata = dict[str, str]


def write_container(path: Path, tensors: Tensors, metadata: Metadata) -> None:
    """Writes tensors and text, as `packed` has them.

    Raises:
      InputError: if the file cannot be written.
    """
    write_atomically(path, packed(tensors, metadata))


def packed(tensors: Tensors, metadata: Metadata) -> bytes:
    """Tensors and text as a file holds them: the same ones as the same bytes.

    Args:
      tensors: by their names.
      metadata: text by its names, with the `format`; the digest is added.
    """
    metadata = {**metadata, "digest": _digest(tensors, metadata)}
    return _ordered(save(tensors, metadata=metadata))


def read_container(
    path: Path, formats: Collection[str], within: Path | None = None
) -> tuple[Metadata, Tensors]:
    """Reads a file back, bit for bit.

    Args:
      path: of the file.
      formats: that the file may have.
      within: a folder that links must not lead out of, if any.

    Returns:
      The text without the digest, and the tensors.

    Raises:
      InputError: naming the file, if it is missing, damaged, of another format, or larger than
        `MOST_POLICY_BYTES`.
    """
    try:
        content = read_bounded(path, MOST_POLICY_BYTES, within)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such policy") from error
    except OSError as error:
        raise InputError(f"{path}: damaged policy file: {error.strerror}") from error
    return unpacked(content, str(path), formats)


def unpacked(content: bytes, path: str, formats: Collection[str]) -> tuple[Metadata, Tensors]:
    """What a file holds, as `read_container` gives it.

    Args:
      content: of the file.
      path: of it, for error messages.
      formats: that it may have.

    Raises:
      InputError: naming the file, if it is damaged or of another format.
    """
    try:
        metadata = _metadata(content)
        if metadata.get("format") not in formats:
            found = f"{metadata.get('format')!r:.40}"
            raise InputError(f"{path}: not a policy of mdpo-rddl (format {found})")
        tensors = load(content)
    except InputError:
        raise
    except Exception as error:  # the library's own, and numpy's for types that it lacks
        raise InputError(f"{path}: damaged policy file: {one_line_cause(error)}") from error
    if metadata.pop("digest", None) != _digest(tensors, metadata):
        raise InputError(f"{path}: damaged policy file: its contents do not match their digest")
    return metadata, tensors


def _ordered(content: bytes) -> bytes:
    """A file's content with its header in the order of the names, which the library leaves open."""
    length = int.from_bytes(content[:_LENGTH_BYTES], "little")
    end = _LENGTH_BYTES + length
    header = json.loads(content[_LENGTH_BYTES:end])
    ordered = json.dumps(header, sort_keys=True, ensure_ascii=False, separators=(",", ":")).encode()
    # the tensors stay aligned
    ordered += b" " * (-len(ordered) % _ALIGNMENT)
    return len(ordered).to_bytes(_LENGTH_BYTES, "little") + ordered + content[end:]


def _metadata(content: bytes) -> Metadata:
    """The text in a file's header.

    Raises:
      ValueError, RecursionError: if there is no such header.
    """
    length = int.from_bytes(content[:_LENGTH_BYTES], "little")
    if not 0 < length <= min(len(content) - _LENGTH_BYTES, _MOST_HEADER_BYTES):
        raise ValueError("it has no header")
    header = json.loads(content[_LENGTH_BYTES : _LENGTH_BYTES + length])
    metadata = header.get("__metadata__", {}) if isinstance(header, dict) else None
    if not isinstance(metadata, dict) or not all(isinstance(v, str) for v in metadata.values()):
        raise ValueError("its header holds something else")
    return metadata


def _digest(tensors: Mapping[str, np.ndarray], metadata: Mapping[str, str]) -> str:
    """The sha256 (hex) of everything in the file but the digest itself."""
    digest = hashlib.sha256(json.dumps(metadata, sort_keys=True).encode())
    for name, tensor in sorted(tensors.items()):
        digest.update(f"{name} {tensor.dtype} {tensor.shape} ".encode())
        digest.update(tensor.tobytes())
    return digest.hexdigest()
