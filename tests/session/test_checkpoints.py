"""The checkpoints of a training: read back, or refused with the name of the file."""

import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.mistakes import one_line

from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.planner.training.checkpoints import TrainingState
from mdpo_rddl.policy.container import read_container, write_container
from mdpo_rddl.session.checkpoints import training_checkpoints
from mdpo_rddl.session.requests import FindTerms

CONFIG = PRESETS["paper"]("tanks").with_values("Optimize", epochs=400)
TERMS: FindTerms = SimpleNamespace(
    problem=SimpleNamespace(digest="d", horizon=5), seed=3, config=CONFIG
)
NUMBERS = {"iterations": 50, "seconds": 1.5, "call": [50, 10], "rule": {}}


def left(folder: Path, **changed: Any) -> Path:
    """Checkpoints of 50 iterations, and of what was changed: the file of these."""
    save = training_checkpoints(folder, TERMS, 1.0).save
    assert save is not None
    tensors = {"loop/key": np.zeros(2, np.uint32)}
    save(TrainingState(tensors, NUMBERS))
    save(TrainingState(tensors, {**NUMBERS, "iterations": 100}))
    path = folder / "checkpoint-1.safetensors"
    text, tensors = read_container(path, ("mdpo-rddl checkpoint 2",))
    text["numbers"] = json.dumps({**json.loads(text["numbers"]), **changed})
    write_container(path, tensors, text)
    return path


def resumed(folder: Path, terms: FindTerms = TERMS) -> TrainingState:
    state = training_checkpoints(folder, terms, 1.0).resumed
    assert state is not None
    return state


def test_the_newest_one_comes_back(tmp_path: Path) -> None:
    left(tmp_path)
    state = resumed(tmp_path)
    assert state.numbers == {**NUMBERS, "iterations": 100}
    np.testing.assert_array_equal(state.tensors["loop/key"], np.zeros(2, np.uint32), strict=True)


@pytest.mark.parametrize(
    ("name", "value"),
    [("iterations", 400), ("seconds", math.inf), ("call", [10**9, 1]), ("call", [])],
)
def test_one_whose_numbers_were_changed_is_not_used(
    tmp_path: Path, name: str, value: Any, caplog: pytest.LogCaptureFixture
) -> None:
    path = left(tmp_path, **{name: value})
    assert resumed(tmp_path).iterations == 50
    assert f"{path}: damaged checkpoint: " in caplog.text
    (tmp_path / "checkpoint-0.safetensors").unlink()
    said = one_line(lambda: resumed(tmp_path))
    assert said.startswith(f"{path}: damaged checkpoint: ValueError('its {name} ")


@pytest.mark.parametrize("iterations", [50, 100, 500])
def test_one_of_another_configuration_is_not_taken_for_damaged(
    tmp_path: Path, iterations: int
) -> None:
    left(tmp_path)
    config = CONFIG.with_values("Optimize", epochs=iterations)
    terms: FindTerms = SimpleNamespace(**{**vars(TERMS), "config": config})
    said = one_line(lambda: resumed(tmp_path, terms))
    path = tmp_path / "checkpoint-0.safetensors"
    assert said == f"{path}: cannot be resumed: it is of another configuration"


def test_a_number_too_large_to_be_counted_on_is_refused(tmp_path: Path) -> None:
    path = left(tmp_path)
    text, tensors = read_container(path, ("mdpo-rddl checkpoint 2",))
    write_container(path, tensors, {**text, "number": "9" * 4300})
    (tmp_path / "checkpoint-0.safetensors").unlink()
    assert one_line(lambda: resumed(tmp_path)).startswith(f"{path}: damaged checkpoint: ValueError")
