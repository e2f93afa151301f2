"""Search without a gradient: covariance matrix adaptation on the exact return.

Hansen (2016), https://arxiv.org/abs/1604.00772, and its separable form for many weights, Ros
and Hansen (2008), by the package cmaes.
"""

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of optional parts that are not installed
    from cmaes import CMA, SepCMA

Evaluate = Callable[[int, np.ndarray], np.ndarray]
"""(iteration, candidates [P, D]) -> mean returns [P]; those that are not finite lose."""

_WORST = -1e30


@dataclass(frozen=True)
class SearchResult:
    """Where a search ended.

    Attributes:
      mean: of the distribution of candidates [D].
      iterations: done.
    """

    mean: np.ndarray
    iterations: int


def search(
    evaluate: Evaluate,
    start: np.ndarray,
    *,
    sigma: float,
    population: int,
    until: float,
    seed: int,
    separable: bool,
    patience: int = 100,
) -> SearchResult:
    """Looks for weights with a large mean return.

    Args:
      evaluate: see `Evaluate`; candidates of one iteration should see the same random numbers.
      start: the first mean [D].
      sigma: the first deviation of each weight.
      population: candidates P of an iteration.
      until: when to end, by `time.monotonic`.
      seed: of the candidates.
      separable: whether to adapt a diagonal covariance only.
      patience: ends after so many iterations in which the candidates' returns are all equal.
    """
    kind = SepCMA if separable else CMA
    optimizer = kind(
        mean=np.asarray(start, float), sigma=sigma, population_size=population, seed=seed
    )
    iterations, flat = 0, 0
    while time.monotonic() < until and flat < patience:
        if not separable and optimizer.should_stop():
            break
        candidates = np.stack([optimizer.ask() for _ in range(population)])
        returns = np.asarray(evaluate(iterations, candidates), float)
        returns = np.where(np.isfinite(returns), returns, _WORST)
        optimizer.tell(list(zip(candidates, -returns, strict=True)))
        iterations += 1
        flat = flat + 1 if np.ptp(returns) == 0.0 else 0
    return SearchResult(optimizer.mean, iterations)
