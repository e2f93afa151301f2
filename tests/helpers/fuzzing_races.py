"""Checkpoints of races with something in them changed."""

import random
import tempfile
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from helpers.config_texts import TEXT
from mdpo_rddl.auto.common.candidate import Candidate, Judged
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.container import read_container, write_container
from mdpo_rddl.session.race_checkpoints import RaceCheckpoints
from mdpo_rddl.session.unfinished import RACE_FILES

FORMAT = "mdpo-rddl race 4"


def terms() -> Any:
    """Of the race that the checkpoint is of."""
    problem = SimpleNamespace(digest="d", horizon=6)
    return SimpleNamespace(problem=problem, seed=3, config=PlannerConfig.from_text(TEXT, "a.cfg"))


def read(folder: Path, chance: random.Random, change: Any) -> None:
    """Reads a changed checkpoint.

    Args:
      folder: where it is.
      chance: what to change.
      change: changes a text.

    Raises:
      InputError: if the checkpoint is refused.
    """
    path = folder / RACE_FILES[0]
    path.write_bytes(checkpoint())
    text, tensors = read_container(path, (FORMAT,))
    name = chance.choice(["about", "about", "curve", "seconds", "number", "terms"])
    if chance.random() < 0.7:
        text[name] = change(text[name], chance).replace("\x00", "")
    else:
        key = chance.choice(sorted(tensors))
        flat = tensors[key].reshape(-1)
        tensors[key] = chance.choice([flat[:1], flat * 0 - 1, flat.astype(np.int8), flat[:0]])
    write_container(path, tensors, text)
    start = RaceCheckpoints(folder, terms(), 60.0).start
    assert start is not None


@cache
def checkpoint() -> bytes:
    """A checkpoint as a race writes it."""
    params = {"rule": {"w": np.arange(6.0).reshape(2, 3)}}
    found = Candidate("pgpe", "pgpe, mean", terms().config, None, params, mean=-5.0, error=0.5)
    with tempfile.TemporaryDirectory() as folder:
        checkpoints = RaceCheckpoints(Path(folder), terms(), 60.0)
        checkpoints.judged(Judged(found, 1.0, became_incumbent=True))
        return (Path(folder) / RACE_FILES[0]).read_bytes()
