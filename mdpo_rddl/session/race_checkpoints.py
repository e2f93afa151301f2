"""What a race leaves behind if it is stopped: its incumbent and the seconds that it has used."""

import json
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING

import jax
import numpy as np

from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.container import Metadata, Tensors
from mdpo_rddl.policy.file import flatten, unflatten
from mdpo_rddl.session.kept import KeptPair
from mdpo_rddl.session.requests import FindTerms
from mdpo_rddl.session.unfinished import RACE_FILES

if TYPE_CHECKING:
    from mdpo_rddl.auto.candidate import Candidate, Judged
    from mdpo_rddl.auto.earlier import EarlierIncumbent

_FORMAT = "mdpo-rddl race 1"


class RaceCheckpoints:
    """The incumbent of a race, written when there is a new one and now and then.

    Attributes:
      start: what an earlier process has left; None if nothing.
    """

    def __init__(self, folder: Path, terms: FindTerms, seconds: float) -> None:
        """Reads what is there.

        Args:
          folder: that is there.
          terms: what is planned.
          seconds: from one checkpoint to the next at most, while candidates are judged.

        Raises:
          InputError: if there is something that cannot be used.
        """
        first, second = RACE_FILES
        self._kept = KeptPair((folder / first, folder / second), _FORMAT, terms, _start)
        self.start: EarlierIncumbent | None = self._kept.newest
        self._seconds = seconds
        self._incumbent: Judged | None = None
        self._saved_at = -math.inf

    def judged(self, judged: "Judged") -> None:
        """A candidate was judged."""
        if judged.became_incumbent and self._is_kept(judged.candidate):
            self._incumbent = judged
        now = time.monotonic()
        if judged.became_incumbent or now - self._saved_at >= self._seconds:
            self._save(judged.seconds)
            self._saved_at = now

    def _is_kept(self, found: "Candidate") -> bool:
        """No table, which is found anew; nothing worse than what the race began with."""
        if found.params is None or self.start is None:
            return found.params is not None
        # without an error it is an estimate of a few episodes
        return math.isfinite(found.error) and found.known_mean >= self.start.mean

    def stopped(self, seconds: float) -> None:
        """The race was ended early, after so many seconds."""
        self._save(seconds)

    def _save(self, seconds: float) -> None:
        if self._incumbent is None:
            return
        found = self._incumbent.candidate
        params = jax.tree.map(np.asarray, found.params)
        hyperparams = jax.tree.map(np.asarray, dict(found.policy_hyperparams))
        tensors = {**flatten(params, "params"), **flatten(hyperparams, "hyperparams")}
        about = {
            "seconds": seconds,
            "arm": found.arm,
            "label": found.label,
            "parents": list(found.parents),
            "uses_noise": found.uses_noise,
            "mean": found.known_mean,
            "error": found.error,
        }
        text = {"config": found.config.to_text(), "about": json.dumps(about)}
        self._kept.write(tensors, text)


def _start(text: Metadata, tensors: Tensors) -> "EarlierIncumbent":
    from mdpo_rddl.auto.earlier import EarlierIncumbent

    about, trees = json.loads(text["about"]), unflatten(tensors)
    start = EarlierIncumbent(
        config=PlannerConfig.from_text(text["config"], "the checkpoint"),
        params=trees["params"],
        policy_hyperparams=trees.get("hyperparams", {}),
        arm=str(about["arm"]),
        label=str(about["label"]),
        parents=tuple(map(str, about["parents"])),
        uses_noise=bool(about["uses_noise"]),
        mean=float(about["mean"]),
        error=float(about["error"]),
        seconds=float(about["seconds"]),
    )
    if not (math.isfinite(start.seconds) and start.seconds >= 0.0):
        raise ValueError("its seconds are not those of a race")
    if not math.isfinite(start.mean):
        raise ValueError("its mean is not that of a policy")
    return start
