"""What candidates return more than the base on the same scenarios: the gains and their errors."""

import math
from dataclasses import dataclass

import numpy as np

NOT_FINITE = -1e30
"""For the gain of a return that is not finite, which must not look like one."""


def paired_gains(returns: np.ndarray, steps: int, is_certain: bool = False) -> np.ndarray:
    """What candidates return more than the first; zero where rounding may have made it.

    A sum of rewards is rounded at each step, by half a unit in its last place at most. Over T steps
    the difference of two sums is off by about sqrt(T) / 4 such units; four times that is not kept.

    Args:
      returns: of the base and of n others [n + 1, N], of the type in which they were computed.
      steps: T, at least 1.
      is_certain: whether the first scenario is what will be played, and the others differ from it
        by rounding alone. None of them counts for more then: else a candidate would gain where
        rounding lets the base return less than it will.

    Returns:
      The gains [n, N]; `NOT_FINITE` where a return is not finite.
    """
    whole = returns.astype(float)
    with np.errstate(invalid="ignore"):
        gains = whole[1:] - whole[:1]
    largest = np.maximum(np.abs(whole[1:]), np.abs(whole[:1]))
    rounding = np.finfo(returns.dtype).eps * math.sqrt(steps) * largest
    kept = np.where(np.abs(gains) > rounding, gains, 0.0)
    found = np.where(np.isfinite(gains), kept, NOT_FINITE)
    return np.minimum(found, found[:, :1]) if is_certain else found


def steps_to_last_change(candidate: np.ndarray, base: np.ndarray, steps: int) -> int:
    """How many steps a candidate takes until its last difference from the base, at least 1.

    What it gains is the gain of so many decisions. Else a change that is put off from decision to
    decision would count at each of them.

    Args:
      candidate, base: [k, D].
      steps: that are left, at least 1.
    """
    differs = np.flatnonzero(np.any(candidate != base, axis=1)[:steps])
    return int(differs[-1]) + 1 if len(differs) else 1


@dataclass
class Scores:
    """What is known of n candidates' gains over the scenarios.

    Attributes:
      count: of scenarios [n].
      total: of the gains [n].
      squares: of the squares of the gains [n].
      lowest, highest: of the gains [n].
    """

    count: np.ndarray
    total: np.ndarray
    squares: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray

    @classmethod
    def of(cls, size: int) -> "Scores":
        """Of candidates that were not played yet."""
        count, total, squares = np.zeros((3, size))
        return cls(count, total, squares, np.full(size, np.inf), np.full(size, -np.inf))

    def add(self, places: np.ndarray, gains: np.ndarray) -> None:
        """Adds the gains [m, N] of some candidates [m]."""
        self.count[places] += gains.shape[1]
        self.total[places] += gains.sum(axis=1)
        self.squares[places] += np.square(gains).sum(axis=1)
        self.lowest[places] = np.minimum(self.lowest[places], gains.min(axis=1))
        self.highest[places] = np.maximum(self.highest[places], gains.max(axis=1))

    @property
    def mean(self) -> np.ndarray:
        """Mean gains [n]; minus infinity for those that were not played."""
        return np.where(self.count > 0, self.total / np.maximum(self.count, 1.0), -np.inf)

    @property
    def error(self) -> np.ndarray:
        """Standard errors of the mean gains [n]; infinite where fewer than two were played.

        That a candidate's n gains are equal does not show that all are. Where others' differ, its
        error is the one that its gains would have with one more, off by as much as any
        candidate's are: d / (n + 1), by add-one smoothing.
        """
        count = np.maximum(self.count, 2.0)
        variance = np.maximum(0.0, self.squares / count - (self.total / count) ** 2)
        seen = np.sqrt(variance / (count - 1.0))
        finite = (self.count > 0) & (self.lowest > NOT_FINITE)
        largest = np.max((self.highest - self.lowest)[finite], initial=0.0)
        error = np.where(self.lowest < self.highest, seen, largest / (count + 1.0))
        return np.where(self.count > 1, error, np.inf)
