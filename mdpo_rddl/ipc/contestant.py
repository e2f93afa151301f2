"""One planner on one instance, as the process does it that is its own."""

import logging
import shutil
import tempfile
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from mdpo_rddl.errors import InputError, one_line_cause
from mdpo_rddl.ipc.planner import Improving, Planner, Restorable, Timed
from mdpo_rddl.ipc.registry import make_planner
from mdpo_rddl.ipc.results import Preparation, Trial
from mdpo_rddl.ipc.rules import Entry, Rules
from mdpo_rddl.ipc.trial import ERROR, MOST_RETURN, OK, play
from mdpo_rddl.machine.memory import peak_mb
from mdpo_rddl.problem.evaluation import episode_seeds
from mdpo_rddl.problem.load import load_problem, make_environment

logger = logging.getLogger(__name__)

IMPROVE, PREPARE, RESTORE = -3, -2, -1
"""The phases that are no trials; those are named by their numbers, from 0."""

_PREPARED = "prepared"
_TRACES = "traces"


class Contestant:
    """Does the phases of an entry when called, and keeps the planner from one to the next.

    Attributes:
      entry: which planner and instance.
      rules: of the run.
      root: the run's folder; what was prepared and the traces are written there.
      improves: whether a planner that can is to use the rest of its time.
      prepared_seconds: that a stopped run has used for what is restored.
    """

    def __init__(self, entry: Entry, rules: Rules, root: Path) -> None:
        """Does nothing yet, so that it can be sent to the process."""
        self.entry, self.rules, self.root = entry, rules, root
        self._planner: Planner | None = None
        self._env: Any = None
        self._began, self.improves, self.prepared_seconds = 0.0, True, 0.0

    @property
    def prepared_folder(self) -> Path:
        """What the planner keeps of its preparation; complete if it is there."""
        return self.entry.folder(self.root / _PREPARED)

    def __call__(self, phase: int) -> dict[str, Any]:
        """`PREPARE` or `RESTORE`, then `IMPROVE`, or a trial.

        Returns:
          A `Preparation` or a `Trial`, as a dictionary.
        """
        started = time.perf_counter()
        if phase >= 0:
            return asdict(self._trial(phase, started))
        status, cause = OK, ""
        try:
            if phase == IMPROVE:
                self._improve()
            else:
                self._began = started - (self.prepared_seconds if phase == RESTORE else 0.0)
                self._get_ready(phase, started)
        except Exception as error:  # whatever a planner raises fails the instance, not the run
            status, cause = ERROR, f"{type(error).__name__}: {one_line_cause(error)}"
        seconds = time.perf_counter() - started
        return asdict(Preparation(status, cause, round(seconds, 3), round(peak_mb())))

    def _get_ready(self, phase: int, started: float) -> None:
        problem = load_problem(self.entry.problem.domain, self.entry.problem.instance)
        self._env = make_environment(problem)
        self._planner = planner = make_planner(self.entry.planner)
        if isinstance(planner, Timed):
            planner.play_within(self.rules.trial_seconds)
        if phase == RESTORE:
            assert isinstance(planner, Restorable)
            planner.restore(problem, self.prepared_folder)
            return
        left = self.rules.plan_seconds - (time.perf_counter() - started)
        planner.prepare(problem, left, self.rules.seed)
        if isinstance(planner, Restorable):
            try:
                self._keep(planner)
            except (OSError, InputError) as error:
                # on a full disk it can be played all the same; only a stopped run begins anew
                cause = one_line_cause(error)
                logger.warning("%s: its preparation is not kept: %s", self.entry.planner, cause)

    def _improve(self) -> None:
        if isinstance(self._planner, Improving):
            self._planner.improve(self.rules.plan_seconds - (time.perf_counter() - self._began))

    def _keep(self, planner: Restorable) -> None:
        folder = self.prepared_folder
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".", dir=folder.parent) as temporary:
            staging = Path(temporary) / folder.name
            staging.mkdir()
            planner.save(staging)
            shutil.rmtree(folder, ignore_errors=True)
            staging.rename(folder)

    def _trial(self, trial: int, started: float) -> Trial:
        assert self._planner is not None
        seed = episode_seeds(self.rules.seed, trial + 1)[trial]
        rng = np.random.default_rng([self.rules.seed, trial])
        played, trace = play(self._env, self._planner, seed, rng, self.rules.lenient)
        status, cause = played.status, played.cause
        try:
            trace.write(self.entry.folder(self.root / _TRACES) / f"trial-{trial:02}.npz")
        except InputError as error:  # a full disk, perhaps of the planner's doing
            status, cause = ERROR, cause or one_line_cause(error)
        return Trial(
            trial=trial,
            status=status,
            cause=cause,
            total=played.total if abs(played.total) <= MOST_RETURN else None,
            steps=played.steps,
            violations=played.violations,
            seconds=round(time.perf_counter() - started, 3),
        )
