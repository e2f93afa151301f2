"""Run folders with something in them changed, and the report that must bear them."""

import json
import random
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from mdpo_rddl.problem.trajectories import Fluent, Trajectories
from mdpo_rddl.session.report.page.record import write_play
from mdpo_rddl.session.report.page.write import write_page

_VALUES = [
    None,
    True,
    -1,
    10**400,
    1e308,
    float("nan"),
    "x",
    "\ud800",
    [],
    {},
    [None, "a"],
    {"a": 1},
]
_RUN = {
    "label": "two",
    "domain": "tanks",
    "instance": "two",
    "horizon": 4,
    "config": "auto",
    "noise": "none",
    "noise_parameters": {"alpha": 1.0},
    "policy": "feedback",
    "seed": 3,
    "mean_return": 3.0,
    "ci95": [0.5, 5.5],
    "returns": [2.0, 4.0],
    "illegal_actions": 4,
    "fallback_actions": 1,
    "train_seconds": 1.5,
    "compile_seconds": 0.5,
    "references": {"noop": {"ci95": None, "returns": [0.0]}, "random": None},
    "warnings": ["a warning"],
    "versions": {"python": "3.11"},
    "optimum": {"value": 5.0, "states": 12},
    "thinking": {
        "decision_seconds": 0.1,
        "method": "halving",
        "reason": "",
        "left_base": 1,
        "decisions": 8,
        "plain_mean_return": 2.5,
        "realised_gain": 0.5,
        "expected_gain": 0.25,
    },
    "rule": {
        "equations": [
            {
                "head": "open is",
                "within": "",
                "terms": [{"text": "+ 2", "size": 1.5, "cost": None, "cost_error": None}],
            }
        ],
        "note": "a note",
    },
    "auto": {
        "chosen": "rule",
        "arm": "rules",
        "parents": [],
        "noop_return": 0.25,
        "random_return": None,
        "arms": {
            "rules": {"seconds": 1.0, "compile_seconds": 0, "iterations": 1, "best_return": None}
        },
        "candidates": [{"seconds": 1.0, "mean_return": 2.5, "became_incumbent": True}],
    },
}
_CONFIG = {"sections": {"Noise": {"sigma": 0.5}}}


def read(folder: Path, chance: random.Random, change: Any) -> Path:
    """Writes the page of a changed run folder.

    Args:
      folder: to be made anew.
      chance: what to change.
      change: changes a text.

    Raises:
      InputError: if the folder is refused.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name, content in run_files().items():
        (folder / name).write_bytes(content)
    name = chance.choice(["summary.json", "summary.json", "config.json", "trajectories.npz"])
    path = folder / name
    if chance.random() < 0.3:
        text = path.read_bytes().decode("latin-1")
        path.write_bytes(change(text, chance).encode("latin-1", "replace"))
    elif path.suffix == ".json":
        value = json.loads(path.read_bytes())
        _replace(value, chance)
        path.write_text(json.dumps(value))
    else:
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
        key = chance.choice(sorted(arrays))
        old = arrays[key]
        new = [old[..., np.newaxis], old.reshape(-1)[:1], old.astype(str), np.array(3)]
        if key == "fluents":
            new.append(np.array(change(str(old), chance)))
        arrays[key] = chance.choice(new)
        np.savez(path, allow_pickle=False, **arrays)
    return write_page(folder)


def _replace(value: Any, chance: random.Random) -> None:
    """Something else for one of the values, however deep, or one value less."""
    while True:
        key = chance.choice(list(value) if isinstance(value, dict) else range(len(value)))
        inner = value[key]
        if not isinstance(inner, dict | list) or not inner or chance.random() < 0.3:
            break
        value = inner
    if chance.random() < 0.2:
        del value[key]
    else:
        value[key] = chance.choice(_VALUES)


@cache
def run_files() -> dict[str, bytes]:
    """A run folder's files that are read, by their names."""
    fluents = (Fluent("action", "open", "real", ("t1",), 1),)
    values = {("action", "open"): np.ones((2, 4, 1), np.float32)}
    play = Trajectories(fluents, np.arange(4), values, np.ones((2, 4), np.float32))
    with tempfile.TemporaryDirectory() as folder:
        write_play(Path(folder), {"policy": play}, np.array([0.001, 0.5]))
        packed = (Path(folder) / "trajectories.npz").read_bytes()
    texts = {"summary.json": _RUN, "config.json": _CONFIG}
    written = {name: json.dumps(value).encode() for name, value in texts.items()}
    return {**written, "trajectories.npz": packed}
