"""Under which conditions a folder's results came about."""

import json
import platform
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mdpo_rddl.errors import InputError
from mdpo_rddl.ipc.rules import Rules
from mdpo_rddl.machine.files import is_temporary, read_json, write_atomically
from mdpo_rddl.machine.versions import versions

CONDITIONS = "run.json"


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
        if root.is_dir() and not all(is_temporary(entry.name) for entry in root.iterdir()):
            raise InputError(f"{root}: is not empty and holds no run; use another --out")
    except OSError as error:
        raise InputError(f"{root}: cannot be read: {error.strerror}") from error
    write_atomically(path, json.dumps(current, indent=2).encode() + b"\n")


def load_conditions(root: Path) -> dict[str, Any]:
    """What `keep_conditions` has written.

    Raises:
      InputError: naming the file, if it is missing or holds something else.
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
    return found
