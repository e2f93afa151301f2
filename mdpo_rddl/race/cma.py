"""Covariance matrix adaptation (CMA-ES): a search without a gradient, as pure functions.

    search = begin(start, sigma, is_full=True)
    vectors = ask(search, 32, random)
    search = tell(search, vectors, returns)

Hansen (2016), https://arxiv.org/abs/1604.00772, whose equations are named below, with his default
constants and negative weights; and the separable form for many dimensions, Ros and Hansen (2008),
https://doi.org/10.1007/978-3-540-87700-4_30, with a diagonal covariance and positive weights alone.
"""

import math
from typing import NamedTuple

import numpy as np

_TINY, _LARGEST_SIGMA = 1e-8, 1e32
# a search has come to nothing whose deviations are so small a part of the first one, or so large,
# or whose covariance has such a condition number; Hansen's values
_TOL_SMALL, _TOL_LARGE, _TOL_CONDITION = 1e-12, 1e4, 1e14
# of a standard deviation: a step that must change the mean
_STEP = 0.2


class Search(NamedTuple):
    """A normal law that moves to where returns are larger.

    Attributes:
      mean: [D].
      sigma: step size; the covariance is sigma^2 C.
      axes: eigenvectors of C in columns [D, D]; None if it is diagonal.
      scales: square roots of its eigenvalues [D].
      path: evolution path of the covariance [D].
      sigma_path: evolution path of the step size [D].
      generation: number of updates.
      first_sigma: step size at first.
    """

    mean: np.ndarray
    sigma: float
    axes: np.ndarray | None
    scales: np.ndarray
    path: np.ndarray
    sigma_path: np.ndarray
    generation: int
    first_sigma: float


def begin(mean: np.ndarray, sigma: float, is_full: bool) -> Search:
    """A search around a vector.

    Args:
      mean: [D], D > 1.
      sigma: standard deviation in each dimension.
      is_full: whether all covariances are adapted, or the variances alone.
    """
    count = len(mean)
    axes = np.eye(count) if is_full else None
    zeros = np.zeros(count)
    return Search(np.array(mean, float), sigma, axes, np.ones(count), zeros, zeros, 0, sigma)


def ask(search: Search, count: int, random: np.random.Generator) -> np.ndarray:
    """Vectors of the law [count, D]."""
    steps = search.scales * random.standard_normal((count, len(search.mean)))
    if search.axes is not None:
        steps = steps @ search.axes.T
    return search.mean + search.sigma * steps


def tell(search: Search, vectors: np.ndarray, returns: np.ndarray) -> Search:
    """The law after an update.

    Args:
      search: that was asked.
      vectors: what it gave [P, D].
      returns: the larger, the better [P].
    """
    is_full, count = search.axes is not None, len(search.mean)
    rates = _rates(count, len(vectors), is_full)
    steps = (vectors[np.argsort(-returns, kind="stable")] - search.mean) / search.sigma
    half = len(vectors) // 2
    step = rates.weights[:half] @ steps[:half]  # eq. 41
    generation = search.generation + 1
    gain = rates.c_sigma * (2.0 - rates.c_sigma) * rates.mass
    sigma_path = (1.0 - rates.c_sigma) * search.sigma_path  # eq. 43
    sigma_path = sigma_path + math.sqrt(gain) * _whitened(search, step)
    usual = math.sqrt(count) * (1.0 - 1.0 / (4.0 * count) + 1.0 / (21.0 * count**2))
    length = float(np.linalg.norm(sigma_path))
    growth = math.exp(min(rates.c_sigma / rates.d_sigma * (length / usual - 1.0), 500.0))
    sigma = min(search.sigma * growth, _LARGEST_SIGMA)  # eq. 44
    whole = math.sqrt(1.0 - (1.0 - rates.c_sigma) ** (2 * (generation + 1)))
    is_steady = length / whole < (1.4 + 2.0 / (count + 1.0)) * usual
    gain = rates.c_path * (2.0 - rates.c_path) * rates.mass
    path = (1.0 - rates.c_path) * search.path + is_steady * math.sqrt(gain) * step  # eq. 45
    lost = 0.0 if is_steady else rates.c_path * (2.0 - rates.c_path)
    kept = 1.0 + rates.c_one * lost - rates.c_one - rates.c_mu * float(rates.weights.sum())
    lengths = np.sum(_whitened(search, steps) ** 2, axis=1)
    weights = rates.weights * np.where(rates.weights < 0.0, count / (lengths + _TINY), 1.0)  # 46
    axes, scales = search.axes, search.scales
    if axes is None:  # eq. 47
        variances = kept * scales**2 + rates.c_one * path**2 + rates.c_mu * weights @ steps**2
    else:
        old = (axes * scales**2) @ axes.T
        update = (weights[:, np.newaxis] * steps).T @ steps
        matrix = kept * old + rates.c_one * np.outer(path, path) + rates.c_mu * update
        variances, axes = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return search._replace(
        mean=search.mean + search.sigma * step,
        sigma=sigma,
        axes=axes,
        scales=np.sqrt(np.where(variances < 0.0, _TINY, variances)),
        path=path,
        sigma_path=sigma_path,
        generation=generation,
    )


def is_over(search: Search) -> bool:
    """Whether nothing comes of the search any more: its law is too narrow, too wide or too flat."""
    axes, scales, sigma = search.axes, search.scales, search.sigma
    variances = scales**2 if axes is None else (axes**2) @ scales**2
    reach = _TOL_SMALL * search.first_sigma
    if np.all(sigma * variances < reach) and np.all(sigma * np.abs(search.path) < reach):
        return True
    if sigma * np.max(scales) > _TOL_LARGE or np.max(scales) > np.sqrt(_TOL_CONDITION) * np.min(
        scales
    ):
        return True
    moved = search.mean + _STEP * sigma * np.sqrt(variances)
    return bool(np.any(moved == search.mean))


class _Rates(NamedTuple):
    """Constants of a number of dimensions and a population.

    Attributes:
      weights: of the vectors, the best first [P].
      mass: effective number of those that the mean is made of.
      c_sigma, d_sigma: of the step size's path, and its damping.
      c_path, c_one, c_mu: of the covariance's path, and of its updates of rank 1 and P.
    """

    weights: np.ndarray
    mass: float
    c_sigma: float
    d_sigma: float
    c_path: float
    c_one: float
    c_mu: float


def _rates(count: int, population: int, is_full: bool) -> _Rates:
    """Hansen's defaults (eq. 49 to 58), or those of Ros and Hansen."""
    half = population // 2
    raw = math.log((population + 1) / 2 if is_full else half + 1) - np.log(
        np.arange(1, population + 1)
    )
    best = raw[:half] / np.sum(raw[:half] if not is_full else raw[raw > 0.0])
    mass = float(np.sum(raw[:half]) ** 2 / np.sum(raw[:half] ** 2))
    c_one = 2.0 / ((count + 1.3) ** 2 + mass)
    if is_full:
        c_mu = 2.0 * (mass - 2.0 + 1.0 / mass) / ((count + 2.0) ** 2 + mass)
        c_mu = min(1.0 - c_one - _TINY, c_mu)
        c_sigma = (mass + 2.0) / (count + mass + 5.0)
        c_path = (4.0 + mass / count) / (count + 4.0 + 2.0 * mass / count)
        others = raw[half:]
        minus = float(np.sum(others) ** 2 / np.sum(others**2))
        least = min(
            1.0 + c_one / c_mu,
            1.0 + 2.0 * minus / (mass + 2.0),
            (1.0 - c_one - c_mu) / (count * c_mu),
        )
        worst = least * others / np.sum(np.abs(raw[raw < 0.0]))
    else:
        c_mu = 2.0 / mass / (count + math.sqrt(2.0)) ** 2
        c_mu += (1.0 - 1.0 / mass) * min(1.0, (2.0 * mass - 1.0) / ((count + 2.0) ** 2 + mass))
        c_mu *= (count + 2.0) / 3.0
        c_sigma = (mass + 2.0) / (count + mass + 3.0)
        c_path = 4.0 / (count + 4.0)
        worst = np.zeros(population - half)
    d_sigma = 1.0 + 2.0 * max(0.0, math.sqrt((mass - 1.0) / (count + 1.0)) - 1.0) + c_sigma
    return _Rates(np.concatenate([best, worst]), mass, c_sigma, d_sigma, c_path, c_one, c_mu)


def _whitened(search: Search, steps: np.ndarray) -> np.ndarray:
    """C^(-1/2) times each of some steps [..., D]."""
    if search.axes is None:
        return np.asarray(steps / search.scales)
    return np.asarray((steps @ search.axes / search.scales) @ search.axes.T)
