"""A run folder as the page shows it, written without a run."""

import json
from pathlib import Path

import numpy as np

from mdpo_rddl.problem.trajectories import Fluent, Trajectories
from mdpo_rddl.session.report.page.record import write_play

SUMMARY = {
    "label": "two <tanks>",
    "domain": "tanks",
    "instance": "two",
    "horizon": 6,
    "config": "auto",
    "noise": "none",
    "noise_parameters": {},
    "policy": "feedback",
    "seed": 3,
    "episodes": 3,
    "mean_return": 3.0,
    "std_return": 1.0,
    "ci95": [0.5, 5.5],
    "returns": [2.0, 3.0, 4.0],
    "episode_lengths": [6, 6, 6],
    "illegal_actions": 4,
    "fallback_actions": 1,
    "references": {
        "noop": {"mean_return": 0.5, "std_return": 0.7, "ci95": [-5.8, 6.8], "returns": [0.0, 1.0]},
        "random": None,
    },
    "warnings": ["too little time & space"],
    "command": "mdpo-plan tanks.rddl two.rddl",
    "versions": {"python": "3.11"},
    "auto": {
        "chosen": "rule",
        "arm": "shared weights",
        "parents": [],
        "noop_return": 0.25,
        "random_return": None,
        "arms": {
            "shared weights": {
                "seconds": 1.0,
                "compile_seconds": 0.5,
                "iterations": 10,
                "best_return": None,
            }
        },
        "candidates": [
            {"seconds": 1.0, "mean_return": 2.5, "became_incumbent": True},
        ],
    },
}
TERM = {"text": "+ 2 (level - 1)", "size": 1.5, "cost": 12.5, "cost_error": 0.25}
LAST = {"text": "+ 3", "size": 0.5, "cost": None, "cost_error": None}
EQUATION = {"head": "open(?t) is true if 0 <", "within": "", "terms": [TERM] * 8 + [LAST]}
SUMMARY["rule"] = {"equations": [EQUATION], "note": "a note"}
FLUENTS = (
    Fluent("state", "level", "real", ("t1", "t2"), 40),
    Fluent("state", "mood", "mood", ("",), 1, ("calm", "angry")),
    Fluent("action", "open", "bool", ("t1", "t2"), 2),
)


def play(seed: int) -> Trajectories:
    rng = np.random.default_rng(seed)
    values = {
        ("state", "level"): rng.normal(size=(3, 6, 2)) * [1.0, 9.0],
        ("state", "mood"): rng.integers(2, size=(3, 6, 1)).astype(float),
        ("action", "open"): rng.integers(2, size=(3, 6, 2)).astype(float),
    }
    values["state", "level"][:, 5:] = np.nan
    return Trajectories(FLUENTS, np.arange(6), values, rng.normal(size=(3, 6)))


def write_run(folder: Path, **changes: object) -> Path:
    folder.mkdir()
    (folder / "summary.json").write_text(json.dumps(SUMMARY | changes))
    (folder / "config.json").write_text('{"sections": {"Noise": {"sigma": 0.5}}}')
    plays = {"policy": play(0), "noop": play(1)}
    write_play(folder, plays, np.array([0.001, 0.002, 0.5]))
    return folder
