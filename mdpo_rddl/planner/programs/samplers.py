"""Counts drawn by inversion: one uniform number each, and one short loop.

JAX draws them by rejection, in loops that draw again: these take seconds to compile, and as long
to run as the unluckiest count needs. The inversion begins at the mode and goes outwards, so that
it takes about as many turns as a count is away from it ("chop-down" from the mode: Kemp 1986, "A
modal method for generating binomial variables"). The mode's probability is that of Loader (2000),
"Fast and accurate computation of binomial probabilities". Counts that spread over hundreds are
quantiles by an expansion around the normal law, whose error is below the resolution of a uniform
number.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax, random
from jax.scipy import special

# log n! less Stirling's formula for it, below the numbers from which a series has it
_STIRLING_ERRORS = np.array(
    [
        0.0,
        0.08106146679532726,
        0.0413406959554093,
        0.02767792568499834,
        0.02079067210376509,
        0.01664469118982119,
        0.01387612882307075,
        0.01189670994589177,
    ]
)
# no count is as likely as that any more
_NEVER = 1e-12
# the variance from which the loop would take too many turns
_WIDE = 1e4


def poisson(key: Array, rate: Array) -> Array:
    """Counts of Poisson laws.

    Args:
      key: JAX random key.
      rate: of each [*shape], finite and not below 0.

    Returns:
      Counts [*shape], as floating-point numbers.
    """
    rate = jnp.asarray(rate)
    mode, safe = jnp.floor(rate), jnp.where(rate > 0.0, rate, 1.0)
    some = jnp.maximum(mode, 1.0)
    log_there = -_stirling_error(some) - _deviance(some, safe) - 0.5 * jnp.log(2.0 * np.pi * some)
    there = jnp.exp(jnp.where(mode > 0.0, log_there, -rate))
    law = _Law(mode, there, rate, rate, 1.0 / jnp.sqrt(safe), 1.0 / safe)
    count = _drawn(key, law, lambda k: rate / (k + 1.0), lambda k: k / safe)
    return jnp.maximum(count, 0.0)


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
    odds = p / (1.0 - p)
    mode = jnp.floor((trials + 1.0) * p)
    # inside, both are positive
    is_inside = (mode > 0.0) & (mode < trials)
    n = jnp.where(is_inside, trials, 2.0)
    k = jnp.where(is_inside, mode, 1.0)
    share = jnp.where(is_inside, p, 0.5)
    log_there = (
        _stirling_error(n)
        - _stirling_error(k)
        - _stirling_error(n - k)
        - _deviance(k, n * share)
        - _deviance(n - k, n * (1.0 - share))
        + 0.5 * jnp.log(n / (2.0 * np.pi * k * (n - k)))
    )
    at_end = jnp.where(mode > 0.0, p**trials, jnp.exp(trials * jnp.log1p(-p)))
    there = jnp.where(is_inside, jnp.exp(log_there), at_end)
    safe = jnp.where(odds > 0.0, odds, 1.0)
    variance = trials * p * (1.0 - p)
    some = jnp.maximum(variance, 1.0)
    skewness, kurtosis = (1.0 - 2.0 * p) / jnp.sqrt(some), (1.0 - 6.0 * p * (1.0 - p)) / some
    count = _drawn(
        key,
        _Law(mode, there, trials * p, variance, skewness, kurtosis),
        lambda k: odds * (trials - k) / (k + 1.0),
        lambda k: k / ((trials - k + 1.0) * safe),
    )
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


class _Law(NamedTuple):
    """A law of counts with one mode, each an array [*shape].

    Attributes:
      mode: the likeliest count.
      there: its probability.
      mean: of the count.
      variance: of the count.
      skewness: of the count.
      kurtosis: of the count, less that of a normal law.
    """

    mode: Array
    there: Array
    mean: Array
    variance: Array
    skewness: Array
    kurtosis: Array


class _Turn(NamedTuple):
    """Of the inversion: how far from the mode, what was found, what is left of the uniform number,
    and how likely the counts were that came last, above and below the mode."""

    distance: Array
    found: Array
    left: Array
    above: Array
    below: Array


def _drawn(
    key: Array, law: _Law, up: Callable[[Array], Array], down: Callable[[Array], Array]
) -> Array:
    """Counts by inversion, from the mode outwards; by Cornish and Fisher's where they spread far.

    Args:
      key: JAX random key.
      law: of each count.
      up: how many times as likely as k is k + 1.
      down: how many times as likely as k is k - 1, 0 for k = 0.
    """
    uniform = random.uniform(key, law.mode.shape, law.there.dtype)
    is_wide = law.variance > _WIDE

    def goes_on(at: _Turn) -> Array:
        return jnp.any(~is_wide & (at.left >= 0.0) & (at.above + at.below > _NEVER))

    def turn(at: _Turn) -> _Turn:
        above = at.above * up(law.mode + at.distance)
        below = at.below * down(law.mode - at.distance)
        distance, left = at.distance + 1.0, at.left - above
        where = law.mode + jnp.where(left < 0.0, distance, -distance)
        found = jnp.where((at.left >= 0.0) & (left - below < 0.0), where, at.found)
        return _Turn(distance, found, left - below, above, below)

    zero = jnp.zeros((), law.there.dtype)
    start = _Turn(zero, law.mode, uniform - law.there, law.there, law.there)
    found = lax.while_loop(goes_on, turn, start).found
    return jnp.where(is_wide, _expanded(law, uniform), found)


def _expanded(law: _Law, uniform: Array) -> Array:
    """The quantile by Cornish and Fisher's (1938) expansion, which errs in 1 / variance^1.5."""
    z = special.ndtri(uniform)
    skewed = law.skewness * (z**2 - 1.0) / 6.0
    curved = (
        law.kurtosis * (z**3 - 3.0 * z) / 24.0 - law.skewness**2 * (2.0 * z**3 - 5.0 * z) / 36.0
    )
    return jnp.floor(law.mean + jnp.sqrt(law.variance) * (z + skewed + curved) + 0.5)


def _stirling_error(number: Array) -> Array:
    """log n! less (n + 1/2) log n - n + log(2 pi) / 2, for whole numbers from 1 on."""
    few = len(_STIRLING_ERRORS) - 1
    known = jnp.asarray(_STIRLING_ERRORS, number.dtype)[jnp.clip(number, 0, few).astype(int)]
    large = jnp.maximum(number, few + 1.0)
    series = (1.0 / 12.0 - (1.0 / 360.0 - 1.0 / (1260.0 * large**2)) / large**2) / large
    return jnp.where(number > few, series, known)


def _deviance(count: Array, mean: Array) -> Array:
    """x log(x / m) + m - x, for x and m above 0, exact where they are close."""
    excess = (mean - count) / count
    return count * (excess - jnp.log1p(excess))
