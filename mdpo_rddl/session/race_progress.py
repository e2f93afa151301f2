"""What a race leaves behind if it is stopped: its candidates, and the seconds that it has used."""

import json
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.errors import printable
from mdpo_rddl.policy.container import Metadata, Tensors
from mdpo_rddl.policy.file import packed_policy, unpacked_policy
from mdpo_rddl.policy.kinds import restored
from mdpo_rddl.race.arm import Candidate
from mdpo_rddl.race.outcome import Curve, Point
from mdpo_rddl.session.kept import KeptPair
from mdpo_rddl.session.report.page.shapes import absent_or, entries, fields, number, text, truth
from mdpo_rddl.session.requests import FindTerms
from mdpo_rddl.session.unfinished import RACE_FILES

_FORMAT = "mdpo-rddl race 5"
# between two files, at least; and of the race, if writing one takes long
_LEAST_SECONDS, _MOST_SHARE = 1.0, 0.05
# of a curve: of a longer one the incumbents alone are kept
_MOST_POINTS = 1_000

_check_curve = entries(
    fields(
        {
            "seconds": number,
            "arm": text,
            "candidate": text,
            "mean_return": absent_or(number),
            "error": absent_or(number),
            "became_incumbent": truth,
        }
    )
)


class Earlier(NamedTuple):
    """What an earlier process has left.

    Attributes:
      candidates: the best one of each arm, the incumbent first.
      curve: all that it has judged.
      seconds: that it has used.
    """

    candidates: tuple[Candidate, ...] = ()
    curve: Curve = ()
    seconds: float = 0.0


class RaceProgress:
    """Writes the best candidates of a race now and then.

    Attributes:
      start: what an earlier process has left.
    """

    def __init__(self, folder: Path, terms: FindTerms, seconds: float) -> None:
        """Reads what is there.

        Args:
          folder: that is there.
          terms: what is planned.
          seconds: from one file to the next, while no incumbent is found.

        Raises:
          InputError: if there is something that cannot be used.
        """
        first, second = RACE_FILES
        paths = folder / first, folder / second
        self._problem, self._source = terms.problem, str(folder)
        self._kept = KeptPair(paths, _FORMAT, terms, self._parsed)
        self.start: Earlier = self._kept.newest or Earlier()
        self._seconds = seconds
        self._best: dict[str, tuple[Candidate, float]] = {}
        self._incumbent: Candidate | None = None
        self._curve = list(self.start.curve)
        self._saved_at, self._cost, self._has_new = time.monotonic(), 0.0, False

    def judged(self, point: Point) -> None:
        """A candidate was judged."""
        found, mean = point.candidate, point.mean
        self._curve.append(point.figures())
        if not math.isfinite(mean):
            return
        best = self._best.get(found.arm)
        if best is None or mean > best[1] or point.became_incumbent:
            self._best[found.arm] = found, mean
        if point.became_incumbent:
            self._incumbent, self._has_new = found, True

    def pulse(self, used: float) -> None:
        """An arm is between two iterations; so many seconds of the race are over."""
        waited = time.monotonic() - self._saved_at
        least = max(_LEAST_SECONDS, self._cost / _MOST_SHARE)
        if waited >= (least if self._has_new else max(least, self._seconds)):
            self.save(used)

    def save(self, used: float) -> None:
        """Writes what is known, if anything is."""
        if self._incumbent is None:
            return
        began = time.monotonic()
        candidates = [self._incumbent]
        candidates += [one for one, _ in self._best.values() if one is not self._incumbent]
        contents = [packed_policy(one.policy.to_saved()) for one in candidates]
        tensors = {f"policy {n}": np.frombuffer(c, np.uint8) for n, c in enumerate(contents)}
        curve = self._curve
        if len(curve) > _MOST_POINTS:
            curve = [point for point in curve if point["became_incumbent"]]
        about = {
            "seconds": used,
            "candidates": [_about(one) for one in candidates],
            "curve": [dict(point) for point in curve],
        }
        self._kept.write(tensors, {"race": json.dumps(about)})
        self._saved_at, self._has_new = time.monotonic(), False
        self._cost = self._saved_at - began

    def _parsed(self, metadata: Metadata, tensors: Tensors) -> Earlier:
        about = json.loads(metadata["race"])
        seconds = float(about["seconds"])
        if not (math.isfinite(seconds) and seconds >= 0.0):
            raise ValueError("its seconds are not those of a race")
        _check_curve(about["curve"], "curve")
        candidates = (
            self._candidate(each, tensors[f"policy {n}"])
            for n, each in enumerate(about["candidates"])
        )
        return Earlier(tuple(candidates), tuple(about["curve"]), seconds)

    def _candidate(self, about: Mapping[str, Any], content: np.ndarray) -> Candidate:
        saved = unpacked_policy(content.tobytes(), self._source)
        return Candidate(
            arm=str(about["arm"]),
            label=printable(str(about["label"])),
            policy=restored(saved, self._problem, self._source),
            parents=tuple(map(str, about["parents"])),
            uses_noise=bool(about["uses_noise"]),
        )


def _about(found: Candidate) -> dict[str, Any]:
    """What is kept of a candidate beside its policy."""
    return {
        "arm": found.arm,
        "label": found.label,
        "parents": list(found.parents),
        "uses_noise": found.uses_noise,
    }
