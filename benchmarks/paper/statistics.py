"""What a sample of returns, one per seed, says."""

from typing import NamedTuple

import numpy as np
from scipy import stats

CONFIDENCE = 0.95
_RESAMPLES = 10_000
_BOOTSTRAP_SEED = 0


class Interval(NamedTuple):
    """A 95% confidence interval."""

    low: float
    high: float

    def overlaps(self, other: "Interval", tolerance: float = 0.0) -> bool:
        """Whether the two share a point, or miss each other by no more than `tolerance`."""
        return self.low <= other.high + tolerance and other.low <= self.high + tolerance


def interquartile_mean(values: np.ndarray, axis: int = -1) -> np.ndarray:
    """Mean of the middle half of the values, a quarter of them cut off at either end.

    Agarwal et al. 2021, "Deep Reinforcement Learning at the Edge of the Statistical Precipice",
    https://arxiv.org/abs/2108.13264.
    """
    return stats.trim_mean(values, 0.25, axis=axis)


def bootstrap_interval(values: np.ndarray) -> Interval:
    """Percentile bootstrap interval of the interquartile mean of one setting's returns [S].

    With a single setting there is one stratum: the stratified bootstrap of Agarwal et al.
    resamples its seeds.
    """
    generator = np.random.default_rng(_BOOTSTRAP_SEED)
    chosen = generator.integers(len(values), size=(_RESAMPLES, len(values)))
    return _percentiles(interquartile_mean(np.asarray(values)[chosen]))


def stratified_interval(scores: np.ndarray) -> tuple[float, Interval]:
    """Interquartile mean of all scores [settings, S], with its stratified bootstrap interval.

    Every setting is a stratum: its seeds are resampled among themselves.
    """
    generator = np.random.default_rng(_BOOTSTRAP_SEED)
    settings, seeds = scores.shape
    chosen = generator.integers(seeds, size=(_RESAMPLES, settings, seeds))
    resampled = scores[np.arange(settings)[:, np.newaxis], chosen]
    means = interquartile_mean(resampled.reshape(_RESAMPLES, -1))
    return float(interquartile_mean(scores.ravel())), _percentiles(means)


def paired_p(ours: np.ndarray, theirs: np.ndarray) -> float | None:
    """One-sided p value that ours are better, seed by seed: Wilcoxon's signed-rank test.

    None where it says nothing: fewer than two seeds, or no difference at all.
    """
    if len(ours) < 2 or not np.any(ours != theirs):
        return None
    return float(stats.wilcoxon(ours, theirs, alternative="greater").pvalue)


def within_seed_interval(returns: np.ndarray) -> Interval:
    """Interval of the mean return of these very policies, from rollouts [S, B] of each.

    The seeds are not a sample here: only the rollouts' spread within each counts.
    """
    seeds, rollouts = returns.shape
    mean = float(returns.mean())
    if rollouts < 2:
        return Interval(-np.inf, np.inf)
    error = float(np.sqrt(returns.var(axis=1, ddof=1).sum() / rollouts) / seeds)
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2, seeds * (rollouts - 1))) * error
    return Interval(mean - half, mean + half)


def _percentiles(means: np.ndarray) -> Interval:
    tail = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(means, [tail, 100 - tail])
    return Interval(float(low), float(high))
