"""Tensors and text in one safetensors file with a digest: nothing in it executes."""

import hashlib
import json
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
import safetensors
from safetensors.numpy import save

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.files import write_atomically

Tensors = dict[str, np.ndarray]
Metadata = dict[str, str]


def write_container(path: Path, tensors: Tensors, metadata: Metadata) -> None:
    """Writes tensors and text.

    Args:
      path: of the file.
      tensors: by their names.
      metadata: text by its names, with the `format`; the digest is added.

    Raises:
      InputError: if the file cannot be written.
    """
    metadata = {**metadata, "digest": _digest(tensors, metadata)}
    write_atomically(path, save(tensors, metadata=metadata))


def read_container(path: Path, formats: Collection[str]) -> tuple[Metadata, Tensors]:
    """Reads a file back, bit for bit.

    Args:
      path: of the file.
      formats: that the file may have.

    Returns:
      The text without the digest, and the tensors.

    Raises:
      InputError: naming the file, if it is missing, damaged or of another format.
    """
    try:
        with safetensors.safe_open(str(path), framework="numpy") as file:
            metadata = file.metadata() or {}
            if metadata.get("format") not in formats:
                found = metadata.get("format")
                raise InputError(f"{path}: not a policy of mdpo-rddl (format {found!r})")
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such policy") from error
    except (OSError, safetensors.SafetensorError) as error:
        cause = " ".join(str(error).split())
        raise InputError(f"{path}: damaged policy file: {cause}") from error
    if metadata.pop("digest", None) != _digest(tensors, metadata):
        raise InputError(f"{path}: damaged policy file: its contents do not match their digest")
    return metadata, tensors


def _digest(tensors: Mapping[str, np.ndarray], metadata: Mapping[str, str]) -> str:
    """The sha256 (hex) of everything in the file but the digest itself."""
    digest = hashlib.sha256(json.dumps(metadata, sort_keys=True).encode())
    for name, tensor in sorted(tensors.items()):
        digest.update(f"{name} {tensor.dtype} {tensor.shape} ".encode())
        digest.update(tensor.tobytes())
    return digest.hexdigest()
