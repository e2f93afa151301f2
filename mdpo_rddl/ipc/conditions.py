"""Under which conditions a folder's results came about."""

import json
import platform
import reprlib
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mdpo_rddl.errors import InputError
from mdpo_rddl.ipc.numbers import is_count, is_finite, is_whole
from mdpo_rddl.ipc.rules import Rules
from mdpo_rddl.machine.files import is_temporary, read_json, write_atomically
from mdpo_rddl.machine.locks import RESULTS_LOCK
from mdpo_rddl.machine.versions import versions

CONDITIONS = "run.json"


def _is_amount(value: Any) -> bool:
    return is_finite(value) and value > 0


def _is_positive_count(value: Any) -> bool:
    return is_count(value) and value > 0


_AMOUNT: tuple[Callable[[Any], bool], str] = (_is_amount, "a number above 0")
_COUNT: tuple[Callable[[Any], bool], str] = (_is_positive_count, "a whole number above 0")
_SHOWN: Mapping[str, tuple[Callable[[Any], bool], str]] = {
    "trials": _COUNT,
    "plan_seconds": _AMOUNT,
    "trial_seconds": _AMOUNT,
    "memory_gb": _AMOUNT,
    "cores": _COUNT,
    "seed": (is_whole, "a whole number"),
    "lenient": (lambda value: isinstance(value, bool), "true or false"),
}
"""What a report shows of them, and what each has to be."""


def keep_conditions(root: Path, rules: Rules, hardware: Mapping[str, Any]) -> None:
    """Writes them into a new folder, and compares them with those of an old one.

    Args:
      root: the run's folder; made if missing.
      rules: of the run.
      hardware: what the planners run on.

    Raises:
      InputError: if the folder was begun under others, holds something else, or cannot be
        written.
    """
    current = {
        **asdict(rules),
        **hardware,
        "machine": platform.machine(),
        "versions": versions(),
    }
    path = root / CONDITIONS
    if path.exists():
        kept = load_conditions(root)
        for name, value in current.items():
            if kept.get(name) != value:
                raise InputError(
                    f"{path}: the run was begun with another {name} "
                    f"({kept.get(name)!r}, now {value!r}); use another --out"
                )
        return
    try:
        names = {entry.name for entry in root.iterdir()} if root.is_dir() else set()
        if not all(is_temporary(name) or name == RESULTS_LOCK for name in names):
            raise InputError(f"{root}: is not empty and holds no run; use another --out")
    except OSError as error:
        raise InputError(f"{root}: cannot be read: {error.strerror}") from error
    write_atomically(path, json.dumps(current, indent=2).encode() + b"\n")


def load_conditions(root: Path) -> dict[str, Any]:
    """What `keep_conditions` has written.

    Raises:
      InputError: naming the file, and the key in it, if it is missing or holds something else.
    """
    path = root / CONDITIONS
    try:
        found = read_json(path, root)
    except FileNotFoundError as error:
        raise InputError(f"{root}: holds no run of mdpo-ipc ({CONDITIONS} is missing)") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{path}: is not JSON: {error}") from error
    if not isinstance(found, dict):
        raise InputError(f"{path}: is not a run's conditions")
    for name, (is_right, wanted) in _SHOWN.items():
        if name not in found:
            raise InputError(f"{path}: {name} is missing")
        if not is_right(found[name]):
            raise InputError(f"{path}: {name} is {reprlib.repr(found[name])}, not {wanted}")
    for name, value in found.items():
        if not _is_plain(value):
            raise InputError(f"{path}: {name!r} is {reprlib.repr(value)}, which no run writes")
    return found


def _is_plain(value: Any, depth: int = 2) -> bool:
    """Whether a value is what reports can hold: finite numbers, and no deep nesting."""
    if isinstance(value, dict | list):
        inner = value.values() if isinstance(value, dict) else value
        return depth > 0 and all(_is_plain(each, depth - 1) for each in inner)
    return not isinstance(value, float) or is_finite(value)
