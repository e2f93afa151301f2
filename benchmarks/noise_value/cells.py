"""One problem, plan and configuration: what is trained with each method, and what is kept of it."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.noise_value.methods import lanes, task_config
from benchmarks.noise_value.names import DEFAULT_SIGMA
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.files import read_json, write_atomically
from mdpo_rddl.machine.versions import versions
from mdpo_rddl.noise import AnnealedNoise

OK = "ok"

LIMIT = "most_seconds"
"""The key of a cell that was left out: which limit was too low for it."""

# the trainings have the sigma
_NOT_RESULTS = ("out", "most_seconds", "sigma")


@dataclass(frozen=True)
class Cell:
    """One cell, and how it is measured.

    Attributes:
      out: results folder.
      problem, instance: names of rddlrepository.
      plan: "slp" or "drp".
      configuration: one of `CONFIGURATIONS`.
      seeds: number of seeds, trained side by side.
      iterations: of each training.
      max_horizon: a longer horizon is cut to it.
      rollouts: of each best iterate on the exact compiled model.
      most_seconds: CPU time that a training's iterations may take; a cell of longer ones is left
        out.
      sigma: of the constant rules and the adaptive one, as a share of the range.
    """

    out: Path
    problem: str
    instance: str
    plan: str
    configuration: str
    seeds: int
    iterations: int
    max_horizon: int
    rollouts: int
    most_seconds: float = math.inf
    sigma: float = DEFAULT_SIGMA

    @property
    def path(self) -> Path:
        """Its file."""
        names = (self.problem, self.instance, self.plan, self.configuration)
        return self.out / "cells" / ("_".join(names) + ".json")

    @property
    def conditions(self) -> dict[str, Any]:
        """What its results depend on, but for the machine."""
        values = {name: value for name, value in asdict(self).items() if name not in _NOT_RESULTS}
        config = task_config(self.problem, self.plan, self.configuration, self.seeds)
        trainings = {name: asdict(lane) for name, lane in lanes(self.sigma).items()}
        rules = {"trainings": trainings, "annealed": asdict(AnnealedNoise())}
        return {**values, "text": config.to_text(), **rules, "versions": versions("optax")}


def save(cell: Cell, result: Mapping[str, Any]) -> None:
    """Writes a cell's file in one step."""
    cell.path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"conditions": cell.conditions, **result}, indent=1) + "\n"
    write_atomically(cell.path, text.encode())


def is_missing(cell: Cell) -> bool:
    """Whether a cell has no file yet, or was left out and has more time now.

    Raises:
      InputError: if the file was made under other conditions.
    """
    kept = load(cell)
    return kept is None or kept.get(LIMIT, math.inf) < cell.most_seconds


def load(cell: Cell) -> dict[str, Any] | None:
    """What a cell's file holds; None if there is none.

    Raises:
      InputError: if it was made under other conditions.
    """
    if not cell.path.exists():
        return None
    kept = read(cell.path)
    wanted = cell.conditions
    for name in wanted:
        if name != "versions" and kept["conditions"].get(name) != wanted[name]:
            raise InputError(f"{cell.path}: was made with another {name}; use another --out")
    return kept


def read(path: Path) -> dict[str, Any]:
    """One file.

    Raises:
      InputError: if it is not a cell's.
    """
    try:
        kept = read_json(path)
        kept["conditions"]["plan"], kept["status"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is not a result of noise-value") from error
    return kept
