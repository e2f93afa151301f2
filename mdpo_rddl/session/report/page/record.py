"""A run folder as the page reads it: whatever an earlier version left out is None."""

import contextlib
import csv
import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.files import MOST_BYTES, printable, read_bounded, read_json, size_text
from mdpo_rddl.problem.trajectories import Trajectories, fluents_text, parse_fluents
from mdpo_rddl.session.report.run_folder import SUMMARY, TRAJECTORIES

_FLUENTS, _SECONDS = "fluents", "decision_seconds"
_MOST_BYTES, _MOST_UNPACKED_BYTES = 2**26, 2**29
_NEEDED = ("label", "domain", "instance", "horizon", "policy", "returns", "mean_return", "seed")


@dataclass(frozen=True, eq=False)
class RunRecord:
    """What a run folder holds.

    Attributes:
      folder: where it is.
      name: what to call the run among others.
      summary: `summary.json`.
      config: `config.json`.
      plays: trajectories of "policy" and "noop".
      decision_seconds: of every decision of the policy's evaluation.
      pictures: contents of the folder's own pictures, by their names.
    """

    folder: Path
    name: str
    summary: Mapping[str, Any]
    config: Mapping[str, Any] | None
    plays: Mapping[str, Trajectories]
    decision_seconds: np.ndarray | None
    pictures: Mapping[str, bytes]


def read_run(folder: Path) -> RunRecord:
    """Reads a run folder of this or an earlier version.

    Raises:
      InputError: naming the folder or the file, if it is missing or damaged.
    """
    path = folder / SUMMARY
    if not path.is_file():
        raise InputError(f"{folder}: no run folder: it has no {SUMMARY}")
    summary = _json(path)
    lacking = [name for name in _NEEDED if name not in summary]
    if lacking:
        raise InputError(f"{path}: not a run's summary: it has no {lacking[0]!r}")
    if cause := summary.get("not_played"):
        raise InputError(f"{path}: nothing to show, the policy was not played: {cause}")
    config = folder / "config.json"
    plays, seconds = read_play(folder / TRAJECTORIES)
    names = ("learning_curve.png", "noise.png")
    return RunRecord(
        folder=folder,
        name=printable(folder.resolve().name),
        summary=summary,
        config=_json(config) if config.is_file() else None,
        plays=plays,
        decision_seconds=_replanned(folder) if seconds is None else seconds,
        pictures={
            n: read_bounded(folder / n, MOST_BYTES, folder) for n in names if (folder / n).is_file()
        },
    )


def write_play(folder: Path, plays: Mapping[str, Trajectories], seconds: np.ndarray) -> None:
    """Writes trajectories and decision times as one compressed `.npz` file without pickles.

    For each play, such as "policy": policy/state/NAME and policy/action/NAME
    [episodes, T, objects], policy/reward [episodes, T], policy/steps [T]; `decision_seconds`;
    `fluents`, JSON that names the objects.

    Args:
      folder: where.
      plays: by whose they are; all have the same fluents.
      seconds: of every decision.
    """
    arrays = {_SECONDS: seconds}
    for name, played in plays.items():
        arrays |= played.arrays(name)
    fluents = next(iter(plays.values())).fluents
    arrays[_FLUENTS] = np.array(fluents_text(fluents))
    np.savez_compressed(folder / TRAJECTORIES, allow_pickle=False, **arrays)


def read_play(path: Path) -> tuple[dict[str, Trajectories], np.ndarray | None]:
    """Reads what `write_play` has written; nothing if there is no such file.

    Raises:
      InputError: naming the file, if it is damaged.
    """
    if not path.is_file():
        return {}, None
    try:
        content = io.BytesIO(read_bounded(path, _MOST_BYTES, path.parent))
        with zipfile.ZipFile(content) as packed:
            unpacked = sum(member.file_size for member in packed.infolist())
        if unpacked > _MOST_UNPACKED_BYTES:
            raise InputError(f"{path}: would unpack to {size_text(unpacked)}, which is too much")
        with np.load(content, allow_pickle=False) as file:
            fluents = parse_fluents(str(file[_FLUENTS]))
            names = [n.removesuffix("/steps") for n in file.files if n.endswith("/steps")]
            # each is uncompressed once
            arrays = {name: file[name] for name in file.files}
            played = [name for name in names if len(arrays[f"{name}/reward"])]
            plays = {name: Trajectories.from_arrays(fluents, arrays, name) for name in played}
            seconds = arrays[_SECONDS]
            return plays, seconds if len(seconds) else None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: damaged: {' '.join(str(error).split())}") from error


def _replanned(folder: Path) -> np.ndarray | None:
    """Seconds of the decisions of a run that planned anew at each."""
    path = folder / "decisions.csv"
    if not path.is_file():
        return None
    with contextlib.suppress(KeyError, ValueError):
        text = read_bounded(path, MOST_BYTES, folder).decode()
        rows = csv.DictReader(io.StringIO(text, newline=""))
        return np.array([float(row["seconds"]) for row in rows])
    return None


def _json(path: Path) -> Any:
    try:
        return read_json(path, path.parent)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: damaged: {' '.join(str(error).split())}") from error
