"""A run folder as the page reads it: whatever an earlier version left out is None."""

import contextlib
import csv
import io
import re
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mdpo_rddl.errors import InputError, one_line_cause, printable
from mdpo_rddl.machine.files import MOST_BYTES, read_bounded, read_json
from mdpo_rddl.problem.trajectories import (
    MOST_STEPS,
    Trajectories,
    fluents_text,
    parse_fluents,
)
from mdpo_rddl.session.report.page.arrays import read_arrays
from mdpo_rddl.session.report.page.checks import check_config, check_summary
from mdpo_rddl.session.report.run_folder import SUMMARY, TRAJECTORIES

_FLUENTS, _SECONDS = "fluents", "decision_seconds"
_LEVEL = 1
# kinds of NumPy's types
_NUMBERS = "fiub"


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
    summary = _json(path, lambda found: _check_played(path, found), "summary")
    config = folder / "config.json"
    plays, seconds = read_play(folder / TRAJECTORIES)
    names = ("learning_curve.png", "noise.png")
    return RunRecord(
        folder=folder,
        name=printable(folder.resolve().name),
        summary=summary,
        config=_json(config, check_config, "configuration") if config.is_file() else None,
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
    # numpy's own compresses at a level that takes several times as long for a tenth less
    with zipfile.ZipFile(
        folder / TRAJECTORIES, "w", zipfile.ZIP_DEFLATED, compresslevel=_LEVEL
    ) as packed:
        for name, array in arrays.items():
            with packed.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.asarray(array), allow_pickle=False)


def read_play(path: Path) -> tuple[dict[str, Trajectories], np.ndarray | None]:
    """Reads what `write_play` has written; nothing if there is no such file.

    Raises:
      InputError: naming the file, if it is damaged.
    """
    if not path.is_file():
        return {}, None
    arrays = read_arrays(path)
    try:
        fluents = parse_fluents(str(arrays[_FLUENTS]))
        # a fluent may have the name too
        names = [n.removesuffix("/steps") for n in arrays if re.fullmatch("[^/]+/steps", n)]
        plays = {name: Trajectories.from_arrays(fluents, arrays, name) for name in names}
        for name, played in plays.items():
            _check_play(name, played)
        seconds = arrays[_SECONDS]
        _check_seconds(seconds)
    except (ValueError, KeyError) as error:
        raise InputError(f"{path}: damaged: {one_line_cause(error)}") from error
    plays = {name: played for name, played in plays.items() if len(played.rewards)}
    return plays, seconds if len(seconds) else None


def _check_play(name: str, play: Trajectories) -> None:
    """Raises ValueError for arrays that are not numbers, not recorded or do not fit each other."""
    if play.rewards.ndim != 2:
        raise ValueError(f"{name[:80]!r} has no rewards of episodes and steps")
    episodes, steps = play.rewards.shape
    if steps > MOST_STEPS:
        raise ValueError(f"{name[:80]!r} has {steps:,} steps, at most {MOST_STEPS} are recorded")
    shapes = {"reward": (play.rewards, (episodes, steps)), "steps": (play.steps, (steps,))}
    for fluent in play.fluents:
        values = play.values[fluent.kind, fluent.name]
        # of no episode at all, the objects are not known
        shape = (episodes, steps, len(fluent.objects)) if episodes else values.shape
        shapes[f"{fluent.kind}/{fluent.name}"] = values, shape
    for what, (array, shape) in shapes.items():
        if array.dtype.kind not in _NUMBERS or array.shape != shape:
            found = f"{array.dtype} of shape {array.shape}"
            raise ValueError(f"{f'{name}/{what}'[:80]!r} is {found}, not numbers of shape {shape}")


def _check_seconds(seconds: np.ndarray) -> None:
    """Raises ValueError unless these are the seconds of decisions."""
    is_row = seconds.ndim == 1 and seconds.dtype.kind in _NUMBERS
    if not is_row or not np.all(np.isfinite(seconds) & (seconds >= 0.0)):
        raise ValueError(f"{_SECONDS} is no row of seconds")


def _replanned(folder: Path) -> np.ndarray | None:
    """Seconds of the decisions of a run that planned anew at each."""
    path = folder / "decisions.csv"
    if not path.is_file():
        return None
    # a stopped run may have left half of a row, and then has no such picture
    with contextlib.suppress(KeyError, TypeError, ValueError, csv.Error):
        text = read_bounded(path, MOST_BYTES, folder).decode()
        rows = csv.DictReader(io.StringIO(text, newline=""))
        seconds = np.array([float(row["seconds"]) for row in rows])
        _check_seconds(seconds)
        return seconds if len(seconds) else None
    return None


def _check_played(path: Path, summary: Any) -> None:
    """As `check_summary`; of a run whose episodes failed there is nothing to check."""
    if isinstance(summary, Mapping) and (cause := summary.get("not_played")):
        cause = one_line_cause(str(cause))
        raise InputError(f"{path}: nothing to show, the policy was not played: {cause}")
    check_summary(summary)


def _json(path: Path, check: Callable[[Any], None], what: str) -> Any:
    try:
        found = read_json(path, path.parent)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: damaged: {one_line_cause(error)}") from error
    try:
        check(found)
    except ValueError as error:
        raise InputError(f"{path}: not a run's {what}: {error}") from error
    return found
