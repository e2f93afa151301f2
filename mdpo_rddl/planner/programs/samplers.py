"""Counts drawn by inversion: one uniform number each.

JAX draws them by rejection, in loops that draw again: these take seconds to compile, and as long
to run as the unluckiest count needs. Small counts are found by adding up their probabilities from 0
on. Where these are many, counts are quantiles by an expansion around the normal law, whose
distribution function errs by less than 2e-5.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax, random

# the variance from which the expansion is as good
_WIDE = 15.0


def poisson(key: Array, rate: Array) -> Array:
    """Counts of Poisson laws.

    Args:
      key: JAX random key.
      rate: of each [*shape], finite and not below 0.

    Returns:
      Counts [*shape], as floating-point numbers.
    """
    rate = jnp.asarray(rate)
    cumulants = _Cumulants(rate, rate, rate, rate, rate)
    return _drawn(key, cumulants, jnp.exp(-rate), lambda count: rate / count)


def binomial(key: Array, trials: Array, probability: Array) -> Array:
    """Counts of binomial laws.

    Args:
      key: JAX random key.
      trials: of each, whole and not below 0 [*shape].
      probability: of each trial, in [0, 1]; of a shape that broadcasts with that of the trials.

    Returns:
      Counts [*shape], as floating-point numbers.
    """
    trials, probability = jnp.broadcast_arrays(jnp.floor(trials), probability)
    p = jnp.minimum(probability, 1.0 - probability)
    odds, skew, spread = p / (1.0 - p), 1.0 - 2.0 * p, p * (1.0 - p)
    shares = 1.0, skew, 1.0 - 6.0 * spread, skew * (1.0 - 12.0 * spread)
    cumulants = _Cumulants(trials * p, *(trials * spread * share for share in shares))
    none = jnp.exp(trials * jnp.log1p(-p))
    count = _drawn(key, cumulants, none, lambda count: odds * (trials - count + 1.0) / count)
    count = jnp.clip(count, 0.0, trials)
    return jnp.where(probability > 0.5, trials - count, count)


def negative_binomial(key: Array, count: Array, probability: Array) -> Array:
    """Failures before so many successes: a Poisson law whose rate is drawn from a gamma law.

    Args:
      key: JAX random key.
      count: of successes, above 0, whole or not [*shape].
      probability: of a success, in [0, 1]; of a shape that broadcasts with that of the count.

    Returns:
      Counts [*shape], as floating-point numbers.
    """
    count, probability = jnp.broadcast_arrays(count, probability)
    rate_key, count_key = random.split(key)
    odds = (1.0 - probability) / probability
    return poisson(count_key, odds * random.gamma(rate_key, count, dtype=count.dtype))


def multinomial(key: Array, trials: Array, shares: Array) -> Array:
    """Counts of multinomial laws: of each category a binomial one, of the trials that are left.

    Args:
      key: JAX random key.
      trials: of each, whole and not below 0; of a shape that broadcasts with `shape`.
      shares: the categories' probabilities, which sum to 1 [*shape, C].

    Returns:
      Counts [*shape, C], as floating-point numbers, which sum to the trials.
    """
    shape = jnp.broadcast_shapes(jnp.shape(trials), shares.shape[:-1])
    trials = jnp.broadcast_to(trials, shape)
    shares = jnp.broadcast_to(shares, (*shape, shares.shape[-1]))
    # of each category among itself and the ones after it
    rest = jnp.cumsum(shares[..., ::-1], axis=-1)[..., ::-1]
    odds = jnp.where(rest > 0.0, shares / jnp.where(rest > 0.0, rest, 1.0), 0.0)
    odds = jnp.clip(odds, 0.0, 1.0).at[..., -1].set(1.0)

    def category(left: Array, given: tuple[Array, Array]) -> tuple[Array, Array]:
        own, share = given
        count = binomial(own, left, share)
        return left - count, count

    keys = random.split(key, shares.shape[-1])
    _, counts = lax.scan(category, trials, (keys, jnp.moveaxis(odds, -1, 0)))
    return jnp.moveaxis(counts, 0, -1)


class _Cumulants(NamedTuple):
    """The first five of a law, each an array [*shape]."""

    mean: Array
    variance: Array
    third: Array
    fourth: Array
    fifth: Array


class _Turn(NamedTuple):
    """Of the sum: up to which count, what was found, what is left of the uniform number, and how
    likely the count that came last."""

    last: Array
    found: Array
    left: Array
    chance: Array


def _drawn(
    key: Array, cumulants: _Cumulants, none: Array, ratio: Callable[[Array], Array]
) -> Array:
    """Counts by inversion: of a sum from 0 on, or of an expansion where that would be long.

    Args:
      key: JAX random key.
      cumulants: of each count.
      none: probability of 0.
      ratio: how many times as likely as the one before a count is, from 1 on.
    """
    resolution = jnp.finfo(none.dtype).eps
    # in the middle between two that can be drawn: 0 itself has no quantile
    uniform = random.uniform(key, none.shape, none.dtype) + resolution / 2.0
    is_wide = cumulants.variance > _WIDE

    def is_open(at: _Turn) -> Array:
        # what is left of the largest uniform numbers may be no more than rounding
        may_be_more = (at.chance > resolution) | (at.last < cumulants.mean)
        return ~is_wide & (at.left >= 0.0) & may_be_more

    def turn(at: _Turn) -> _Turn:
        count = at.last + 1.0
        chance = at.chance * ratio(count)
        found = jnp.where(is_open(at), count, at.found)
        return _Turn(count, found, at.left - chance, chance)

    # of what is no number there is no count
    start = _Turn(jnp.zeros((), none.dtype), 0.0 * none, uniform - none, none)
    found = lax.while_loop(lambda at: jnp.any(is_open(at)), turn, start).found
    return jnp.where(is_wide, _expanded(cumulants, uniform), found)


def _expanded(cumulants: _Cumulants, uniform: Array) -> Array:
    """The quantile by the expansion of Cornish and Fisher (1938), which errs in 1 / variance^2.

    What is rounded to a count has the cumulants of the count but for Sheppard's (1897) corrections.
    """
    z = np.sqrt(2.0) * lax.erf_inv(2.0 * uniform - 1.0)
    variance = jnp.maximum(cumulants.variance, _WIDE) - 1.0 / 12.0
    scale = jnp.sqrt(variance)
    skewed = cumulants.third / scale**3
    curved = (cumulants.fourth + 1.0 / 120.0) / variance**2
    fifth = cumulants.fifth / scale**5
    added = (
        skewed * (z**2 - 1.0) / 6.0
        + curved * (z**3 - 3.0 * z) / 24.0
        - skewed**2 * (2.0 * z**3 - 5.0 * z) / 36.0
        + fifth * (z**4 - 6.0 * z**2 + 3.0) / 120.0
        - skewed * curved * (z**4 - 5.0 * z**2 + 2.0) / 24.0
        + skewed**3 * (12.0 * z**4 - 53.0 * z**2 + 17.0) / 324.0
    )
    return jnp.maximum(0.0, jnp.floor(cumulants.mean + scale * (z + added) + 0.5))
