"""What a race leaves behind if it is stopped: the best policy of each arm, and its seconds."""

import json
import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from mdpo_rddl.errors import printable
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.container import Metadata, Tensors
from mdpo_rddl.policy.plan_rule import parse_rule, rule_text
from mdpo_rddl.policy.table import Estimate, parse_table, table_tensors, table_text
from mdpo_rddl.policy.trees import flatten, unflatten
from mdpo_rddl.session.kept import KeptPair
from mdpo_rddl.session.requests import FindTerms
from mdpo_rddl.session.unfinished import RACE_FILES

if TYPE_CHECKING:
    from mdpo_rddl.auto.common.candidate import Candidate, Judged
    from mdpo_rddl.auto.common.curve import Curve
    from mdpo_rddl.auto.resuming.earlier import EarlierPolicy, EarlierRace

# those of earlier versions have the arms' states besides, which nobody reads
_FORMAT = "mdpo-rddl race 4"
# what a checkpoint may take at any time; of the race, if it takes longer
_CHEAP_SECONDS, _MOST_SHARE = 0.1, 0.05


class RaceCheckpoints:
    """A race's best policies and its seconds, written with a new incumbent and now and then.

    Attributes:
      start: what an earlier process has left; None if nothing.
    """

    def __init__(self, folder: Path, terms: FindTerms, seconds: float) -> None:
        """Reads what is there.

        Args:
          folder: that is there.
          terms: what is planned.
          seconds: from one checkpoint to the next, while no incumbent is found.

        Raises:
          InputError: if there is something that cannot be used.
        """
        first, second = RACE_FILES
        self._kept = KeptPair((folder / first, folder / second), _FORMAT, terms, _start)
        self.start: EarlierRace | None = self._kept.newest
        self._seconds, self._race_seconds = seconds, terms.config.budget().seconds
        self._ends = math.inf
        self._incumbent: Candidate | None = None
        self._best: dict[str, Candidate] = {}
        self._curve: Curve = () if self.start is None else self.start.curve
        self._saved_at, self._cost, self._has_new = -math.inf, 0.0, False
        self._used: Callable[[], float] | None = None

    def begun(self, used: Callable[[], float]) -> None:
        """A race has begun; what is given says how many seconds it has used."""
        self._used = used
        earlier = 0.0 if self.start is None else self.start.seconds
        self._ends = time.monotonic() + self._race_seconds - earlier

    def judged(self, judged: "Judged") -> None:
        """A candidate was judged."""
        from mdpo_rddl.auto.common.curve import candidate_figures, shortened

        found = judged.candidate
        self._curve = shortened((*self._curve, candidate_figures(judged)))
        if _is_policy(found):
            best = self._best.get(found.arm)
            if best is None or found.known_mean > best.known_mean:
                self._best[found.arm] = found
        if judged.became_incumbent and self._is_kept(found):
            self._incumbent = found
        self._has_new |= judged.became_incumbent
        if self._is_due:
            self._save(judged.seconds)

    def pulse(self) -> None:
        """An arm is between two iterations."""
        if self._is_due:
            self._save()

    @property
    def _is_due(self) -> bool:
        # it must not make the race end late
        return self._is_wanted and self._cost <= self._ends - time.monotonic()

    @property
    def _is_wanted(self) -> bool:
        waited = time.monotonic() - self._saved_at
        # it must not take too much of the race
        is_cheap = self._cost <= _CHEAP_SECONDS or waited >= self._cost / _MOST_SHARE
        # a new incumbent at once
        return is_cheap and (self._has_new or waited >= self._seconds)

    def _is_kept(self, found: "Candidate") -> bool:
        """No proven optimum, nothing that diverged, nothing worse than what it began with."""
        if not _is_policy(found) or not math.isfinite(found.known_mean):
            return False
        if self.start is None:
            return True
        # without an error it is an estimate of a few episodes
        return math.isfinite(found.error) and found.known_mean >= self.start.incumbent.mean

    def stopped(self, seconds: float) -> None:
        """The race was ended early, after so many seconds."""
        self._save(seconds)

    def _save(self, seconds: float | None = None) -> None:
        started = time.monotonic()
        self._write(seconds)
        self._saved_at, self._has_new = time.monotonic(), False
        self._cost = self._saved_at - started

    def _write(self, seconds: float | None) -> None:
        if self._incumbent is None and self.start is None:
            return
        best_so_far: Candidate | EarlierPolicy
        if self._incumbent is not None:
            best_so_far = self._incumbent
        elif self.start is not None:  # it was not judged yet in this race
            best_so_far = self.start.incumbent
        if seconds is None:
            assert self._used is not None
            seconds = self._used()
        others: list[Candidate | EarlierPolicy] = [
            best for best in self._best.values() if best is not best_so_far
        ]
        if self.start is not None:  # those that were not judged yet in this race
            others += [policy for policy in self.start.others if policy.arm not in self._best]
        tensors: Tensors = {}
        about: list[dict[str, Any]] = []
        others = [best for best in others if math.isfinite(best.mean or 0.0)]
        for number, found in enumerate([best_so_far, *others]):
            described = {"number": str(number), **_about(found)}
            if found.table is not None:
                own = table_tensors(found.table[0])
                tensors |= {f"{number}/{name}": each for name, each in own.items()}
                described["table"] = table_text(*found.table)
            elif found.plans is not None:
                described["plans"] = rule_text(*found.plans)
            else:
                tree = {"params": found.params, "hyperparams": dict(found.policy_hyperparams)}
                tensors |= flatten(jax.tree.map(np.asarray, tree), str(number))
            about.append(described)
        text = {
            "seconds": str(seconds),
            "about": json.dumps(about),
            "curve": json.dumps([dict(point) for point in self._curve]),
        }
        self._kept.write(tensors, text)


def _is_policy(found: "Candidate") -> bool:
    """Whether it can be kept: a proven optimum, which ends the race, is neither of them."""
    return any(each is not None for each in (found.params, found.table, found.plans))


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
    from mdpo_rddl.auto.common.curve import read_curve
    from mdpo_rddl.auto.resuming.earlier import EarlierRace

    seconds = float(text["seconds"])
    incumbent, *others = (_policy(about, tensors) for about in json.loads(text["about"]))
    if not (math.isfinite(seconds) and seconds >= 0.0):
        raise ValueError("its seconds are not those of a race")
    curve = read_curve(json.loads(text["curve"]), seconds)
    return EarlierRace(seconds, incumbent, tuple(others), curve)


def _part(tensors: Tensors, prefix: str) -> Tensors:
    return {n.removeprefix(prefix): each for n, each in tensors.items() if n.startswith(prefix)}


def _policy(about: Mapping[str, Any], tensors: Tensors) -> "EarlierPolicy":
    from mdpo_rddl.auto.resuming.earlier import EarlierPolicy

    own, found, plans = _part(tensors, f"{about['number']}/"), None, None
    tree: dict[str, Any] = {"params": None}
    if "table" in about:
        table, claim = parse_table(own, about["table"])
        if not isinstance(claim, Estimate):
            raise ValueError("its table has no estimate")
        found = table, claim
    elif "plans" in about:
        plans = parse_rule(about["plans"])
    else:
        tree = unflatten(own)
    policy = EarlierPolicy(
        config=PlannerConfig.from_text(about["config"], "the checkpoint"),
        params=tree["params"],
        policy_hyperparams=tree.get("hyperparams", {}),
        table=found,
        plans=plans,
        arm=str(about["arm"]),
        label=printable(str(about["label"])),
        parents=tuple(map(str, about["parents"])),
        uses_noise=bool(about["uses_noise"]),
        mean=float(about["mean"]),
        error=float(about["error"]),
    )
    if not math.isfinite(policy.mean):
        raise ValueError("its mean is not that of a policy")
    return policy
