"""Where a method is better or worse than another, seed by seed and over all problems."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import stats

LEVEL = 0.05
_RESAMPLES = 10_000
# of a return that was summed in 32 bit
_ROUNDING = 1e-6


def t_test_p(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Two-sided p value of Student's paired t-test [S]; 1 where all seeds are the same to rounding.

    With five seeds a rank test could not fall below 0.06.
    """
    lead = np.asarray(ours, float) - np.asarray(theirs, float)
    size = np.maximum(np.abs(ours), np.abs(theirs))
    if np.all(np.abs(lead) <= _ROUNDING * size) or len(lead) < 2 or not np.all(np.isfinite(lead)):
        return 1.0
    error = lead.std(ddof=1) / np.sqrt(len(lead))
    if error == 0.0:
        return 0.0
    return float(2.0 * stats.t.sf(abs(lead.mean()) / error, len(lead) - 1))


def holm(p_values: Sequence[float]) -> np.ndarray:
    """Holm's adjusted p values: each is compared with the level as it is.

    Holm 1979, "A simple sequentially rejective multiple test procedure".
    """
    values = np.asarray(p_values, float)
    order = np.argsort(values, kind="stable")
    factors = len(values) - np.arange(len(values))
    adjusted = np.empty_like(values)
    adjusted[order] = np.minimum(1.0, np.maximum.accumulate(values[order] * factors))
    return adjusted


def normalised(returns: Mapping[str, np.ndarray], noop: float) -> dict[str, np.ndarray]:
    """Scores of each method's seeds [S]: 0 at the no-op or below, 1 at the best mean.

    Args:
      returns: per method [S], of one problem.
      noop: the no-op's return.
    """
    best = max((float(np.mean(values)) for values in returns.values()), default=noop)
    if not best > noop:
        return {name: np.zeros(len(values)) for name, values in returns.items()}
    return {
        name: np.clip((np.asarray(values) - noop) / (best - noop), 0.0, 1.0)
        for name, values in returns.items()
    }


def stratified_mean(scores: Sequence[np.ndarray]) -> tuple[float, float, float]:
    """Mean over problems and seeds, and its 95% stratified bootstrap interval.

    Each problem's seeds [S] are resampled among themselves.
    """
    generator = np.random.default_rng(0)
    means = np.zeros(_RESAMPLES)
    for values in scores:
        chosen = generator.integers(len(values), size=(_RESAMPLES, len(values)))
        means += np.asarray(values)[chosen].mean(axis=1) / len(scores)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(np.mean([np.mean(values) for values in scores])), float(low), float(high)
