"""Checkpoints of a race that has judged what a test says."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from mdpo_rddl.auto.common.candidate import Candidate, Judged
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.session.race_checkpoints import RaceCheckpoints

FORMAT = "mdpo-rddl race 4"
CONFIG = PRESETS["paper"]("tanks")
PARAMS = {"rule": {"w": np.arange(6.0).reshape(2, 3)}, "b": np.ones(2, np.float32)}


def terms(**others: Any) -> Any:
    values = {"digest": "d", "horizon": 7, "seed": 3, **others}
    problem = SimpleNamespace(digest=values["digest"], horizon=values["horizon"])
    return SimpleNamespace(problem=problem, seed=values["seed"], config=CONFIG)


def judged(mean: float, seconds: float, became_incumbent: bool = True, arm: str = "plan") -> Judged:
    candidate = Candidate(
        arm=arm,
        label="a plan",
        config=CONFIG,
        planner=None,
        params={**PARAMS, "b": np.full(2, mean, np.float32)},
        parents=("rules",),
        uses_noise=True,
        mean=mean,
        error=0.5,
    )
    return Judged(candidate, seconds, became_incumbent)


def arena(config: Any, shapes: Any) -> Any:
    structure = {
        "rule": {"w": SimpleNamespace(shape=shapes[0])},
        "b": SimpleNamespace(shape=shapes[1]),
    }
    planner = SimpleNamespace(params_structure=lambda hyperparams: structure)
    probe = SimpleNamespace(policy_seconds=None)
    return SimpleNamespace(config=config, planner=planner, probe=probe)


def kept(folder: Path, *found: Judged, seconds: float = 60.0) -> Any:
    checkpoints = RaceCheckpoints(folder, terms(), seconds)
    for each in found:
        checkpoints.judged(each)
    return RaceCheckpoints(folder, terms(), seconds).start
