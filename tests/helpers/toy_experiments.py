"""The experiments at a size for tests: interrupted, resumed and compiled once."""

import contextlib
from collections.abc import Iterator
from typing import Any

import pytest

from benchmarks.common import full_training
from benchmarks.common.records import Records
from benchmarks.common.size import Size
from benchmarks.presets import noise_sweep, paper_preset
from benchmarks.problems.attempts import COLUMNS, KEYS
from helpers.problems import ROOT
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.training import training
from mdpo_rddl.session import training as session_training

OPTIONS = ["--settings", "powergen7", "--seeds", "2", "--iterations", "3", "--episodes", "2"]
SETTINGS = ["powergen7"]
SIZE = Size(seeds=2, iterations=3, episodes=2)


@contextlib.contextmanager
def compiled_once() -> Iterator[None]:
    """The shipped files, and planners that are compiled once for all tests of a file."""
    planners: dict[str, Any] = {}

    def build(problem, config, traced_cache=None):
        key = problem.label + config.with_section("Optimize", {}).to_text()
        if key not in planners:
            planners[key] = build_planner(problem, config).planner
        return Built(planners[key], config.budget(), config.jaxplan_arguments()[2])

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        for module in (noise_sweep, paper_preset, session_training):
            patch.setattr(module, "build_planner", build)
        yield


def nothing_to_do(*args: Any, **kwargs: Any) -> None:
    """Stands for work that must not be done again."""
    raise AssertionError("there is nothing left to do")


def interrupt_training(monkeypatch, number: int) -> None:
    """Presses Ctrl-C in the first iteration of the given training, counted from 0."""
    begun: list[int] = []

    def train(*arguments: Any, **kwargs: Any):
        begun.append(len(begun))
        if begun[-1] == number:
            kwargs["on_progress"] = interrupt
        return training.train(*arguments, **kwargs)

    def interrupt(progress) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(full_training, "train", train)


def add_row(records: Records, *key: str, **values: object) -> None:
    """Adds an attempt's row that is ok but for what is given."""
    row = {"status": "ok", "cause": "", "horizon": 20, "seconds": 1.6, "peak_mb": 600.4, **values}
    records.add(*key, *(row.get(name, "") for name in COLUMNS[len(KEYS) :]))
