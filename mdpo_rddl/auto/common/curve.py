"""The candidates of a race over its seconds, as JSON can hold them."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from mdpo_rddl.auto.common.candidate import Judged
from mdpo_rddl.machine.files import finite_or_none

Curve = Sequence[Mapping[str, Any]]
"""Each candidate as `candidate_figures` has it, in the order in which they were judged."""

MOST_POINTS = 10_000
"""That one process leaves for the next."""


def candidate_figures(judged: Judged) -> dict[str, Any]:
    """A judged candidate as JSON can hold it; None for a return that is not finite."""
    candidate = judged.candidate
    return {
        "seconds": round(judged.seconds, 3),
        "arm": candidate.arm,
        "candidate": candidate.label,
        "mean_return": finite_or_none(candidate.mean),
        "error": finite_or_none(candidate.error),
        "became_incumbent": judged.became_incumbent,
    }


def late_gain(curve: Curve, seconds: float, floor: float | None) -> float | None:
    """What the best policy has gained in the last half of a race, as a share of all it has gained.

    About 0 where more time is of no use; 1 where all was found late.

    Args:
      curve: of the race.
      seconds: that it took.
      floor: mean return with which a gain begins: that of the no-op or of random actions.

    Returns:
      The share; None where nothing was gained, or it is not known.
    """
    best = [
        (point["seconds"], point["mean_return"]) for point in curve if point["became_incumbent"]
    ]
    if not best or floor is None or any(mean is None for _, mean in best):
        return None
    last = best[-1][1]
    if not last > floor:
        return None
    early = [mean for when, mean in best if when <= seconds / 2.0]
    # the first incumbents may return less than random actions do
    before = max(floor, early[-1]) if early else floor
    return float(max(0.0, last - before) / (last - floor))


def shortened(curve: Curve) -> Curve:
    """The curve; if it is long, its latest points, and of these those that were the best."""
    if len(curve) > MOST_POINTS:
        curve = [point for point in curve if point["became_incumbent"]]
    return tuple(curve[-MOST_POINTS:])


def read_curve(values: Any, seconds: float) -> Curve:
    """A curve that was written.

    Args:
      values: as JSON has them.
      seconds: none was judged later.

    Raises:
      AttributeError, LookupError, OverflowError, TypeError, ValueError: if it is none.
    """
    if len(values) > MOST_POINTS:
        raise ValueError(f"its candidates are {len(values)}")
    curve = tuple(map(_point, values))
    # they are rounded
    times = [0.0, *(point["seconds"] for point in curve), seconds + 0.01]
    if any(later < earlier for earlier, later in pairwise(times)):
        raise ValueError("its candidates are not in their order")
    return curve


def _point(values: Mapping[str, Any]) -> Mapping[str, Any]:
    names = values["arm"], values["candidate"]
    if not all(isinstance(each, str) for each in names):
        raise ValueError(f"{names!r:.80} are no names")
    if not isinstance(values["became_incumbent"], bool):
        raise ValueError("whether a candidate was the best is no truth")
    return {
        "seconds": _number(values["seconds"]),
        "arm": values["arm"],
        "candidate": values["candidate"],
        "mean_return": _number_or_none(values["mean_return"]),
        "error": _number_or_none(values["error"]),
        "became_incumbent": values["became_incumbent"],
    }


def _number(value: Any) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"a candidate has {number}")
    return number


def _number_or_none(value: Any) -> float | None:
    return None if value is None else _number(value)
