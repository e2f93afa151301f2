"""Traced programs on disk, so that the next process need not trace them again.

JAX's compilation cache spares the compiler, but not the tracing of the Python function nor its
lowering, without which the cache cannot be asked.
"""

import contextlib
import hashlib
import importlib.metadata
import importlib.util
import logging
import pickle
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import export

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.device import current_device
from mdpo_rddl.machine.files import write_atomically
from mdpo_rddl.planner.programs.quick import Jit

logger = logging.getLogger(__name__)

_TRACED_LIBRARIES = ("jax", "jaxlib", "numpy", "optax", "flax")
# some work on these
_TRACED_PACKAGES = ("mdpo_rddl", "pyRDDLGym", "pyRDDLGym_jax")
_MOST_FILES = 200


def stored_jit(
    folder: Path,
    identity: str,
    function: Callable[..., Any] | None = None,
    jit: Jit = jax.jit,
) -> Callable[..., Any]:
    """`jax.jit` for one device, with the traced program kept in a folder.

    The program that is compiled is the stored one, in the process that has traced it as well,
    so the results do not depend on whether it was there. What JAX cannot export, and arguments
    on several devices, are left to `jax.jit`.

    The folder is trusted as JAX's compilation cache is: its files are unpickled.

    Args:
      folder: made if missing; a file for each program.
      identity: all that the function depends on besides its arguments, in words. The code of
        this package and of the libraries behind it, and JAX's settings, need not be mentioned.
      function: a pure function of positional arguments; if missing, the result is a decorator.
      jit: compiles the traced program.
    """
    if function is None:
        return partial(stored_jit, folder, identity, jit=jit)
    plain = jit(function)
    programs: dict[Any, Callable[..., Any]] = {}

    def call(*arguments: Any) -> Any:
        leaves, tree = jax.tree.flatten(arguments)
        leaves = [_strongly_typed(leaf) for leaf in leaves]
        devices = _devices_of(leaves)
        if len(devices) != 1:
            return plain(*arguments)
        # a program's results are bound to its device; arguments that were not yet would be
        # reason enough for JAX to compile it once more
        leaves = jax.device_put(leaves, *devices)
        types = tuple((leaf.shape, str(leaf.dtype)) for leaf in leaves)
        if (tree, types) not in programs:
            digest = _digest(identity, str(tree), str(types))
            programs[tree, types] = _program(folder / digest, function, leaves, tree, jit)
        return programs[tree, types](*leaves)

    return call


def _program(
    path: Path, function: Callable[..., Any], leaves: list[Any], tree: Any, jit: Jit
) -> Callable[..., Any]:
    """The stored program of the leaves; traced and stored if there is none."""
    try:
        exported, result_tree = _read(path)
    except Exception as error:  # whatever a missing, damaged or foreign file makes pickle raise
        if not isinstance(error, FileNotFoundError):
            logger.info("%s: not used: %r", path, error)
        try:
            exported, result_tree = _export(function, leaves, tree)
            content = pickle.dumps((exported.serialize(), result_tree))
        except Exception as error:  # whatever the program holds that JAX does not export
            logger.info("the program is not stored: %r", error)
            return jit(lambda *leaves: function(*jax.tree.unflatten(tree, leaves)))
        _write(path, content)
    compiled = jit(exported.call)
    return lambda *leaves: jax.tree.unflatten(result_tree, compiled(*leaves))


def _export(function: Callable[..., Any], leaves: list[Any], tree: Any) -> tuple[Any, Any]:
    result_tree = None

    def flat(*leaves: Any) -> list[Any]:
        nonlocal result_tree
        results, result_tree = jax.tree.flatten(function(*jax.tree.unflatten(tree, leaves)))
        return results

    return export.export(jax.jit(flat))(*leaves), result_tree


def _read(path: Path) -> tuple[Any, Any]:
    program, result_tree = pickle.loads(path.read_bytes())
    with contextlib.suppress(OSError):
        path.touch()  # the longest unused go first
    return export.deserialize(program), result_tree


def _write(path: Path, content: bytes) -> None:
    """And removes what was unused for longest."""
    try:
        write_atomically(path, content)
    except InputError as error:  # a full or read-only disk costs the next process some seconds
        logger.info("not stored: %s", error)
        return
    with contextlib.suppress(OSError):  # another process removes some as well
        by_use = sorted(path.parent.iterdir(), key=lambda kept: kept.stat().st_mtime)
        for unused in by_use[:-_MOST_FILES]:
            unused.unlink(missing_ok=True)


def _strongly_typed(leaf: Any) -> Any:
    """Without the weak type of a Python number, which a program's arguments do not have."""
    if isinstance(leaf, jax.Array) and not leaf.weak_type:
        return leaf
    return np.asarray(leaf, jax.dtypes.canonicalize_dtype(jnp.result_type(leaf)))


def _devices_of(leaves: list[Any]) -> set[Any]:
    arrays = [leaf for leaf in leaves if isinstance(leaf, jax.Array)]
    return set().union(*(array.devices() for array in arrays)) or {current_device()}


def _digest(*texts: str) -> str:
    settings = repr(sorted(jax.config.values.items()))
    device = current_device()
    known = (*texts, settings, device.platform, device.device_kind, *_code())
    return hashlib.sha256("\0".join(known).encode()).hexdigest()


@cache
def _code() -> list[str]:
    """What tells apart two versions of the code that is traced, edited ones included."""
    versions = [f"{name} {importlib.metadata.version(name)}" for name in _TRACED_LIBRARIES]
    files = []
    for name in _TRACED_PACKAGES:
        spec = importlib.util.find_spec(name)
        folders = (spec and spec.submodule_search_locations) or []
        files += [path for folder in folders for path in Path(folder).rglob("*.py")]
    states = [(path, path.stat()) for path in sorted(files)]
    return versions + [f"{path} {s.st_size} {s.st_mtime_ns}" for path, s in states]
