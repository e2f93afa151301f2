"""Planners for the toy problem that win, lose and fail; imported by their processes too."""

import os
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np

from helpers.problems import tiny_files
from mdpo_rddl.ipc.rules import Entry, Instance, Rules

RULES = Rules(trials=3, plan_seconds=60.0, trial_seconds=60.0, memory_gb=8.0)


def tiny_instance(folder: Path, spread: float = 0.3) -> Instance:
    """The toy problem: two units start at 0, the goal is 0.5, a push is at most 1."""
    folder.mkdir(exist_ok=True)
    return Instance(*tiny_files(folder, horizon=3, spread=spread))


def entry(problem: Instance, planner: type | str) -> Entry:
    """An entry of one of the planners below, or of a known one, or of another module's."""
    name = planner if isinstance(planner, str) else f"{planner.__module__}:{planner.__name__}"
    return Entry(problem, name)


class Steady:
    """Pushes half the way to the goal; the base of the others."""

    share = 0.5

    def prepare(self, problem: Any, seconds: float, seed: int) -> None:
        assert 0 < seconds <= 60
        self.trial = -1

    def act(self, step: int, state: Any, rng: np.random.Generator) -> dict[str, Any]:
        self.trial += step == 0
        return {"push": self.push(step, state, rng)}

    def push(self, step: int, state: Any, rng: np.random.Generator) -> Any:
        return np.clip(self.share * (0.5 - state["x"]), -1, 1)


class Exact(Steady):
    """Goes to the goal at once: nobody is better."""

    share = 1.0


class TooFar(Steady):
    """Breaks the precondition in the second step of every trial."""

    def push(self, step, state, rng):
        return np.full(2, 1.5) if step == 1 else np.zeros(2)


class Raising(Steady):
    """Raises an error in the second trial."""

    def push(self, step, state, rng):
        if self.trial == 1:
            raise RuntimeError("no plan\n  for this")
        return super().push(step, state, rng)


class Dying(Steady):
    """Takes its process along in the second trial, after it has started another."""

    def prepare(self, problem, seconds, seed):
        super().prepare(problem, seconds, seed)
        child = subprocess.Popen(["sleep", "600"])
        Path(os.environ["CHILD_FILE"]).write_text(str(child.pid))

    def push(self, step, state, rng):
        if self.trial == 1:
            os._exit(3)
        return super().push(step, state, rng)


class Hanging(Steady):
    """Thinks for too long in the second trial."""

    def push(self, step, state, rng):
        if self.trial == 1:
            time.sleep(600)
        return super().push(step, state, rng)


class Unready(Steady):
    """Cannot prepare."""

    def prepare(self, problem, seconds, seed):
        raise ValueError("out of ideas")


class Erratic(Steady):
    """Prepares otherwise each time, and draws random numbers while it plays."""

    def prepare(self, problem, seconds, seed):
        super().prepare(problem, seconds, seed)
        self.share = np.random.default_rng().random()

    def push(self, step, state, rng):
        return np.clip(super().push(step, state, rng) + 0.1 * rng.normal(size=2), -1, 1)


class Remembering(Erratic):
    """The same, but can be taken up again."""

    def save(self, folder: Path) -> None:
        (folder / "share").write_text(repr(float(self.share)))

    def restore(self, problem: Any, folder: Path) -> None:
        self.trial = -1
        self.share = float((folder / "share").read_text())


class Improver(Remembering):
    """Uses the time that its preparation has left."""

    def improve(self, seconds: float) -> None:
        assert 0 < seconds < 60


class NoActs:
    """Is no planner."""

    def prepare(self, problem, seconds, seed):
        pass


class Pausing(Steady):
    """Takes its time, and can be taken up again."""

    def push(self, step, state, rng):
        time.sleep(0.2)
        return super().push(step, state, rng)

    def save(self, folder: Path) -> None:
        pass

    def restore(self, problem: Any, folder: Path) -> None:
        self.prepare(problem, 1.0, 0)
