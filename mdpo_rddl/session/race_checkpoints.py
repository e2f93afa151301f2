"""What a race leaves behind if it is stopped: the best policy of each arm, and the seconds used."""

import json
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
    from mdpo_rddl.auto.earlier import EarlierPolicy, EarlierRace

_FORMAT = "mdpo-rddl race 2"


class RaceCheckpoints:
    """The best policies of a race, written when there is a new incumbent and now and then.

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
        self.start: EarlierRace | None = self._kept.newest
        self._seconds = seconds
        self._incumbent: Candidate | None = None
        self._best: dict[str, Candidate] = {}
        self._saved_at = -math.inf

    def judged(self, judged: "Judged") -> None:
        """A candidate was judged."""
        found = judged.candidate
        if found.params is not None:  # a table is found anew
            best = self._best.get(found.arm)
            if best is None or found.known_mean > best.known_mean:
                self._best[found.arm] = found
        if judged.became_incumbent and self._is_kept(found):
            self._incumbent = found
        now = time.monotonic()
        if judged.became_incumbent or now - self._saved_at >= self._seconds:
            self._save(judged.seconds)
            self._saved_at = now

    def _is_kept(self, found: "Candidate") -> bool:
        """No table, nothing that diverged, nothing worse than what the race began with."""
        if found.params is None or not math.isfinite(found.known_mean):
            return False
        if self.start is None:
            return True
        # without an error it is an estimate of a few episodes
        return math.isfinite(found.error) and found.known_mean >= self.start.incumbent.mean

    def stopped(self, seconds: float) -> None:
        """The race was ended early, after so many seconds."""
        self._save(seconds)

    def _save(self, seconds: float) -> None:
        if self._incumbent is None:
            return
        others: list[Candidate | EarlierPolicy] = [
            best for best in self._best.values() if best is not self._incumbent
        ]
        if self.start is not None:  # those that were not judged yet in this race
            others += [policy for policy in self.start.others if policy.arm not in self._best]
        tensors: Tensors = {}
        about: list[dict[str, Any]] = []
        others = [best for best in others if math.isfinite(best.mean or 0.0)]
        for number, found in enumerate([self._incumbent, *others]):
            tree = {"params": found.params, "hyperparams": dict(found.policy_hyperparams)}
            tensors |= flatten(jax.tree.map(np.asarray, tree), str(number))
            about.append({"number": str(number), **_about(found)})
        self._kept.write(tensors, {"seconds": str(seconds), "about": json.dumps(about)})


def _about(found: "Candidate | EarlierPolicy") -> dict[str, Any]:
    return {
        "config": found.config.to_text(),
        "arm": found.arm,
        "label": found.label,
        "parents": list(found.parents),
        "uses_noise": found.uses_noise,
        "mean": found.mean,
        "error": found.error,
    }


def _start(text: Metadata, tensors: Tensors) -> "EarlierRace":
    from mdpo_rddl.auto.earlier import EarlierRace

    trees, seconds = unflatten(tensors), float(text["seconds"])
    incumbent, *others = (
        _policy(about, trees[about["number"]]) for about in json.loads(text["about"])
    )
    if not (math.isfinite(seconds) and seconds >= 0.0):
        raise ValueError("its seconds are not those of a race")
    return EarlierRace(seconds, incumbent, tuple(others))


def _policy(about: Mapping[str, Any], tree: Mapping[str, Any]) -> "EarlierPolicy":
    from mdpo_rddl.auto.earlier import EarlierPolicy

    policy = EarlierPolicy(
        config=PlannerConfig.from_text(about["config"], "the checkpoint"),
        params=tree["params"],
        policy_hyperparams=tree.get("hyperparams", {}),
        arm=str(about["arm"]),
        label=str(about["label"]),
        parents=tuple(map(str, about["parents"])),
        uses_noise=bool(about["uses_noise"]),
        mean=float(about["mean"]),
        error=float(about["error"]),
    )
    if not math.isfinite(policy.mean):
        raise ValueError("its mean is not that of a policy")
    return policy
