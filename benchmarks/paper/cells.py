"""What is kept of one setting and method: a folder of its own, written file by file."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load, save

from benchmarks.common.records import Records
from benchmarks.common.size import Size
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.files import read_bounded, read_json, write_atomically
from mdpo_rddl.policy.container import MOST_POLICY_BYTES
from mdpo_rddl.policy.trees import flatten, unflatten

_PLAYED = "played.csv"
_PLAYED_COLUMNS = ("seed", "returns", "seconds")

_PARAMS = "params"


@dataclass(frozen=True)
class PaperSize(Size):
    """The size of one cell's measurement; only the last iterate plays `episodes`.

    Attributes:
      rollouts: of each evaluated iterate on the exact compiled model.
    """

    rollouts: int


@dataclass(frozen=True)
class Cell:
    """One cell of the paper's table, and how it is measured.

    Attributes:
      out: results folder.
      setting, method: what is trained with what.
      size: of the measurement.
    """

    out: Path
    setting: str
    method: str
    size: PaperSize

    @property
    def folder(self) -> Path:
        """Where its files are."""
        return self.out / "cells" / f"{self.setting}_{self.method}"


@dataclass(frozen=True)
class Trained:
    """What a training and its evaluation on the exact compiled model gave.

    Attributes:
      conditions: what it was made with.
      seconds: of building and compiling, training, and evaluating.
      iterations: the evaluated iterates, as numbers of iterations done [C].
      elapsed: training seconds till each [C].
      returns: mean return of each seed's iterates [S, C].
      last_returns: every rollout of each seed's last iterate [S, B].
      sigma: adaptive noise's scale per iterate and step, mean over seeds [C, H]; else None.
    """

    conditions: Mapping[str, Any]
    seconds: Mapping[str, float]
    iterations: list[int]
    elapsed: list[float]
    returns: np.ndarray
    last_returns: np.ndarray
    sigma: np.ndarray | None

    @property
    def seeds(self) -> int:
        """Number of seeds."""
        return len(self.returns)


def save_trained(folder: Path, trained: Trained, last_params: Any) -> None:
    """Writes a training and the last iterates' parameters [S, ...], each whole or not at all.

    What was played with other policies is forgotten.
    """
    (folder / _PLAYED).unlink(missing_ok=True)
    names = ("conditions", "seconds", "iterations", "elapsed")
    values = {name: getattr(trained, name) for name in names}
    arrays = {"returns": trained.returns, "last_returns": trained.last_returns}
    values |= {name: np.round(array, 3).tolist() for name, array in arrays.items()}
    values["sigma"] = None if trained.sigma is None else np.round(trained.sigma, 3).tolist()
    lines = [f'  "{name}": {json.dumps(value)}' for name, value in values.items()]
    write_atomically(folder / "policies.safetensors", save(flatten(last_params, _PARAMS)))
    write_atomically(folder / "training.json", "{\n" + ",\n".join(lines) + "\n}\n")


def load_trained(folder: Path) -> Trained | None:
    """Reads what `save_trained` wrote; None if there is nothing.

    Raises:
      InputError: if the file is something else.
    """
    path = folder / "training.json"
    try:
        values = read_json(path, folder)
        sigma = values["sigma"]
        return Trained(
            values["conditions"],
            values["seconds"],
            values["iterations"],
            values["elapsed"],
            np.array(values["returns"], float),
            np.array(values["last_returns"], float),
            None if sigma is None else np.array(sigma, float),
        )
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is not a training of the paper: {error!r}") from error


def load_policies(folder: Path) -> Any:
    """The last iterates' parameters [S, ...].

    Raises:
      InputError: if they cannot be read.
    """
    path = folder / "policies.safetensors"
    try:
        return unflatten(load(read_bounded(path, MOST_POLICY_BYTES, folder)))[_PARAMS]
    except Exception as error:  # safetensors has exceptions of its own
        raise InputError(f"{path}: cannot be read: {error}") from error


def open_played(folder: Path, episodes: int) -> Records:
    """The returns of each seed's last iterate on the numpy environment, a row per seed.

    Raises:
      InputError: as `Records` does.
    """
    return Records(folder / _PLAYED, _PLAYED_COLUMNS, ("seed",), {"episodes": episodes})


def load_played(folder: Path) -> tuple[dict[int, np.ndarray], float]:
    """Per seed, its episodes' returns; and how long they took, in seconds.

    Raises:
      InputError: if the file is something else.
    """
    if not (folder / _PLAYED).exists():
        return {}, 0.0
    records = Records(folder / _PLAYED, _PLAYED_COLUMNS, ("seed",))
    try:
        returns = {
            int(row["seed"]): np.array([float(value) for value in row["returns"].split()])
            for row in records.rows
        }
        return returns, sum(float(row["seconds"]) for row in records.rows)
    except ValueError as error:
        raise InputError(f"{records.path}: is not a file of returns: {error}") from error
