"""What happened in a trial, step by step, as a compressed file."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mdpo_rddl.machine.files import write_atomically
from mdpo_rddl.problem.observation import is_observed


class Trace:
    """State, action and reward of each step.

    The file is numpy's compressed `.npz`, without pickles: "reward" [T], and for each fluent
    "state/NAME" [T, *shape], as observed before the action, and "action/NAME" [T, *shape].

    What is not observed yet, as before the first step of a partially observed problem, is NaN:
    a fluent of bools or integers is then kept as floats. Of names of objects it is "".
    """

    def __init__(self) -> None:
        self._columns: dict[str, list[Any]] = {}
        self._rewards: list[float] = []

    def add(self, state: Mapping[str, Any], actions: Mapping[str, Any], reward: float) -> None:
        """Appends one step."""
        for kind, values in (("state", state), ("action", actions)):
            for name, value in values.items():
                self._columns.setdefault(f"{kind}/{name}", []).append(value)
        self._rewards.append(reward)

    def arrays(self) -> dict[str, np.ndarray]:
        """The file's contents."""
        columns = {name: _stack(values) for name, values in self._columns.items()}
        return {"reward": np.array(self._rewards), **columns}

    def write(self, path: Path) -> None:
        """Writes the steps so far.

        Raises:
          InputError: naming the file, if it cannot be written.
        """
        content = io.BytesIO()
        np.savez_compressed(content, allow_pickle=False, **self.arrays())
        write_atomically(path, content.getvalue())


def _stack(values: list[Any]) -> np.ndarray:
    seen = [np.asarray(value) for value in values if is_observed(value)]
    if len(seen) == len(values):
        return np.asarray(values)
    shape = seen[0].shape if seen else ()
    names = bool(seen) and seen[0].dtype.kind == "U"
    hidden = np.full(shape, "" if names else np.nan)
    return np.stack([np.asarray(value) if is_observed(value) else hidden for value in values])
