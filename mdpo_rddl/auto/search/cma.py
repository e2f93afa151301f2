"""Covariance matrix adaptation of weights on the exact return, without a gradient.

Hansen (2016), https://arxiv.org/abs/1604.00772, and its separable form for many weights, Ros
and Hansen (2008), by the package cmaes.
"""

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mdpo_rddl.auto.common.timing import Clock

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of optional parts that are not installed
    from cmaes import CMA, SepCMA

Evaluate = Callable[[int, np.ndarray], np.ndarray]
"""(iteration, candidates [P, D]) -> mean returns [P]; those that are not finite lose."""

FEWEST_TO_STALL = 60
"""Iterations before an adaptation may end for want of a gain."""

_WORST = -1e30


@dataclass(frozen=True)
class Sampling:
    """How candidates are drawn.

    Attributes:
      sigma: the first deviation of each weight.
      population: candidates P of an iteration.
      seed: of the candidates, at least 1.
      separable: whether to adapt a diagonal covariance only.
      patience: ends after so many iterations in which the candidates' returns are all equal.
      least_gain: ends once the candidates' median return over the latest quarter of the
        iterations (of `FEWEST_TO_STALL` or more) is larger than that over the quarter before by
        no more than such a share of what was gained since the first one; 0 for never.
    """

    sigma: float
    population: int
    seed: int
    separable: bool = False
    patience: int = 100
    least_gain: float = 0.0


class Adaptation:
    """A distribution of weights that moves to where returns are large.

    Attributes:
      iterations: done so far.
    """

    def __init__(self, start: np.ndarray, sampling: Sampling, clock: Clock = time.monotonic):
        """Evaluates nothing yet.

        Args:
          start: the first mean [D].
          sampling: how candidates are drawn.
          clock: what `run` asks for the time.
        """
        self._sampling, self._clock = sampling, clock
        kind = SepCMA if sampling.separable else CMA
        self._optimizer = kind(
            mean=np.array(start, float),  # which it changes
            sigma=sampling.sigma,
            population_size=sampling.population,
            seed=sampling.seed,
        )
        self.iterations, self._flat = 0, 0
        # of the candidates, at each iteration
        self._medians: list[float] = []

    @property
    def mean(self) -> np.ndarray:
        """Mean of the distribution [D]."""
        return np.asarray(self._optimizer.mean)

    @property
    def converged(self) -> bool:
        """Whether more iterations would change nothing."""
        if self._flat >= self._sampling.patience or self._has_stalled:
            return True
        return not self._sampling.separable and bool(self._optimizer.should_stop())

    @property
    def _has_stalled(self) -> bool:
        least, medians = self._sampling.least_gain, self._medians
        if not least or len(medians) < FEWEST_TO_STALL:
            return False
        quarter = len(medians) // 4
        before = float(np.mean(medians[-2 * quarter : -quarter]))
        now = float(np.mean(medians[-quarter:]))
        first = next((median for median in medians if median > 0.1 * _WORST), before)
        return now - before <= least * max(0.0, now - first)

    def run(self, evaluate: Evaluate, until: float) -> None:
        """Adapts until it has converged or the time is over.

        Args:
          evaluate: see `Evaluate`; candidates of one iteration should see the same random
            numbers.
          until: when to end, by the clock.
        """
        while self._clock() < until and not self.converged:
            candidates = np.stack([self._optimizer.ask() for _ in range(self._sampling.population)])
            returns = np.asarray(evaluate(self.iterations, candidates), float)
            returns = np.where(np.isfinite(returns), returns, _WORST)
            self._optimizer.tell(list(zip(candidates, -returns, strict=True)))
            self.iterations += 1
            self._medians.append(float(np.median(returns)))
            self._flat = self._flat + 1 if np.ptp(returns) == 0.0 else 0
