"""Two measurements of one task, compared over their common episodes."""

import json
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.common.markdown import rounded
from benchmarks.tasks.trial import OK
from mdpo_rddl.problem.evaluation import mean_interval

Rows = Sequence[Mapping[str, str]]
"""One for each seed."""
# of the returns: rounding, no difference
_SLACK = 1e-6


class Paired(NamedTuple):
    """The means of two measurements, and their difference.

    Attributes:
      cells: the first mean, the second one, and the difference with its 95% interval.
      sign: 1 where the first is larger beyond the interval, -1 where it is smaller, else 0.
    """

    cells: Sequence[str]
    sign: int


def paired(first: Rows, second: Rows) -> Paired:
    """Compares, episode by episode, the means over the seeds; a failure is below any return.

    Args:
      first: rows of a task, whose episodes begin as those of the second do.
      second: other rows of the task.
    """
    ours, theirs = common_returns(first), common_returns(second)
    if ours is None or theirs is None:
        cells = ["failed" if each is None else _mean(each) for each in (ours, theirs)]
        return Paired([*cells, ""], int(ours is not None) - int(theirs is not None))
    return paired_returns(ours, theirs)


def paired_returns(ours: np.ndarray, theirs: np.ndarray) -> Paired:
    """Compares returns of episodes [E]; the longer one is cut."""
    common = min(len(ours), len(theirs))
    ours, theirs = ours[:common], theirs[:common]
    gain = ours - theirs
    mean = float(np.mean(gain))
    low, high = mean_interval(gain) or (mean, mean)
    slack = _SLACK * max(1.0, float(np.max(np.abs(ours))))
    sign = int(low > slack) - int(high < -slack)
    gained = f"{rounded(mean, 4)} [{rounded(low, 4)}, {rounded(high, 4)}]"
    return Paired([_mean(ours), _mean(theirs), gained], sign)


def common_returns(rows: Rows) -> np.ndarray | None:
    """Per episode that all seeds have [E] the mean over them; None if one has no returns."""
    if any(row["status"] != OK for row in rows):
        return None
    found = [json.loads(row["returns"]) for row in rows]
    return np.mean([returns[: min(map(len, found))] for returns in found], axis=0)


def _mean(returns: np.ndarray) -> str:
    return rounded(float(returns.mean()), 6)
