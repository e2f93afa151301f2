"""Counts drawn by inversion have their laws."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from mdpo_rddl.planner.acting import enable_x64
from mdpo_rddl.planner.programs import samplers
from mdpo_rddl.planner.programs.samplers import binomial, multinomial, negative_binomial, poisson

DRAWS = 20_000


def has_law(draws: np.ndarray, law) -> bool:
    """A chi-square test on the values that are expected often enough, the tails together."""
    values = np.arange(int(draws.max()) + 1)
    expected = len(draws) * law.pmf(values)
    kept = expected >= 10.0
    counts = np.array([np.sum(draws == value) for value in values[kept]])
    seen = np.append(counts, len(draws) - counts.sum())
    wanted = np.append(expected[kept], len(draws) - expected[kept].sum())
    if wanted[-1] < 10.0:
        seen, wanted = seen[:-1], wanted[:-1] * (seen[:-1].sum() / wanted[:-1].sum())
    return len(seen) < 2 or stats.chisquare(seen, wanted).pvalue > 1e-4


@pytest.mark.parametrize(
    "rate", [0.0, 1e-3, 0.4, 1.0, 3.7, 8.0, 25.5, 700.0, 9_999.0, 12_345.6, 3e6]
)
def test_poisson(rate):
    draws = np.asarray(jax.jit(poisson)(jax.random.PRNGKey(1), jnp.full(DRAWS, rate)))
    assert np.all((draws >= 0.0) & (draws == np.floor(draws)))
    assert has_law(draws, stats.poisson(rate))
    assert draws.mean() == pytest.approx(rate, abs=5.0 * np.sqrt(rate / DRAWS))


@pytest.mark.parametrize("trials", [0, 1, 2, 7, 60, 2000, 10**6])
@pytest.mark.parametrize("probability", [0.0, 1e-3, 0.3, 0.5, 0.77, 1.0])
def test_binomial(trials, probability):
    numbers = jnp.full(DRAWS, float(trials))
    draws = np.asarray(jax.jit(binomial)(jax.random.PRNGKey(2), numbers, probability))
    assert np.all((draws >= 0.0) & (draws <= trials) & (draws == np.floor(draws)))
    assert has_law(draws, stats.binom(trials, probability))


@pytest.mark.parametrize(
    ("draw", "law", "error"),
    [
        (poisson, stats.poisson(15.001), 2e-5),
        (poisson, stats.poisson(25.5), 1e-5),
        (poisson, stats.poisson(130.0), 1e-5),
        (lambda key, size: binomial(key, size, 0.001), stats.binom(15026, 0.001), 2e-5),
        (lambda key, size: binomial(key, size, 0.02), stats.binom(1300, 0.02), 1e-5),
        (lambda key, size: binomial(key, size, 0.8), stats.binom(170, 0.8), 1e-5),
    ],
    ids=["few", "poisson", "poisson, many", "few of many", "binomial, rare", "binomial, often"],
)
def test_counts_that_spread_have_nearly_their_laws(monkeypatch, draw, law, error):
    # an even grid in place of random numbers shows the distribution function itself
    grid = (np.arange(10**6) + 0.5) / 10**6
    monkeypatch.setattr(samplers.random, "uniform", lambda key, shape, dtype: jnp.asarray(grid))
    size = law.args[0]
    with enable_x64(True):
        counts = np.asarray(draw(jax.random.PRNGKey(0), jnp.full(len(grid), float(size))))
    values = np.arange(law.ppf(1e-6), law.ppf(1 - 1e-6) + 1)
    below = np.searchsorted(np.sort(counts), values, side="right") / len(grid)
    np.testing.assert_allclose(below, law.cdf(values), atol=error)


RARELY = 2.0**-23


@pytest.mark.parametrize("uniform", [0.0, RARELY, 1.0 - RARELY, 1.0 - 4.0 * RARELY])
def test_the_ends_of_the_uniform_numbers_have_counts(monkeypatch, uniform):
    given = np.float32(uniform)
    monkeypatch.setattr(
        samplers.random, "uniform", lambda key, shape, dtype: jnp.full(shape, given, dtype)
    )
    rates = np.array([0.01, 0.5, 3.0, 7.0, 14.9, 100.0, 5e4])
    trials, chances = np.array([3, 50, 50, 10**6, 10**6]), np.array([0.3, 0.5, 0.1, 0.7, 1e-6])
    key, lowest, highest = jax.random.PRNGKey(0), 1e-9, 1 - 1e-9
    counts = np.asarray(poisson(key, jnp.asarray(rates, jnp.float32)))
    law = stats.poisson(rates)
    assert np.all((law.ppf(lowest) <= counts) & (counts <= law.ppf(highest)))
    # whatever else is drawn beside it
    assert [float(poisson(key, jnp.float32(rate))) for rate in rates] == counts.tolist()
    numbers, shares = jnp.asarray(trials, jnp.float32), jnp.asarray(chances, jnp.float32)
    counts = np.asarray(binomial(key, numbers, shares))
    law = stats.binom(trials, chances)
    assert np.all((law.ppf(lowest) <= counts) & (counts <= law.ppf(highest)))


def test_of_no_number_there_is_no_count():
    key, nan = jax.random.PRNGKey(0), jnp.float32(np.nan)
    assert np.isnan(poisson(key, nan))
    assert np.isnan(binomial(key, jnp.float32(3.0), nan))


@pytest.mark.parametrize("count", [0.5, 1.0, 3.0, 40.0])
@pytest.mark.parametrize("probability", [0.05, 0.4, 0.9, 1.0])
def test_negative_binomial(count, probability):
    counts = jnp.full(DRAWS, count)
    draws = np.asarray(jax.jit(negative_binomial)(jax.random.PRNGKey(4), counts, probability))
    assert np.all((draws >= 0.0) & (draws == np.floor(draws)))
    assert has_law(draws, stats.nbinom(count, probability))


def test_multinomial():
    shares = np.array([[0.2, 0.0, 0.5, 0.3], [0.0, 1.0, 0.0, 0.0]])
    trials = jnp.array([7.0, 3.0])
    keys = jax.random.split(jax.random.PRNGKey(5), DRAWS)
    draws = np.asarray(jax.vmap(multinomial, in_axes=(0, None, None))(keys, trials, shares))
    np.testing.assert_array_equal(draws.sum(axis=-1), np.broadcast_to(trials, (DRAWS, 2)))
    np.testing.assert_array_equal(draws[:, 1], np.broadcast_to([0, 3, 0, 0], (DRAWS, 4)))
    for category in (0, 1, 2, 3):
        assert has_law(draws[:, 0, category], stats.binom(7, shares[0, category]))
    expected = stats.multinomial(7, shares[0]).cov()
    np.testing.assert_allclose(np.cov(draws[:, 0].T), expected, atol=0.1)
    # the same trials for all
    assert multinomial(keys[0], jnp.array(4.0), jnp.asarray(shares)).shape == (2, 4)


def test_laws_side_by_side():
    rates = jnp.array([[0.0, 2.0], [30.0, 0.5]])
    keys = jax.random.split(jax.random.PRNGKey(3), 4000)
    draws = np.asarray(jax.vmap(poisson, in_axes=(0, None))(keys, rates))
    assert draws.shape == (4000, 2, 2)
    np.testing.assert_allclose(draws.mean(axis=0), rates, atol=0.4)
    # with one key the numbers are common to all
    same = jax.vmap(poisson, in_axes=(None, 0))(keys[0], jnp.full((3, 5), 4.0))
    np.testing.assert_array_equal(same, np.broadcast_to(same[0], (3, 5)))


def test_what_is_no_law_ends():
    rates = jnp.array([np.nan, -1.0, np.inf, 1e30])
    assert poisson(jax.random.PRNGKey(0), rates).shape == (4,)
    chances = jnp.array([np.nan, -1.0, 2.0, 0.5])
    assert binomial(jax.random.PRNGKey(0), jnp.array([5.0, 5.0, -1.0, np.inf]), chances).shape == (
        4,
    )


def test_in_64_bit():
    with enable_x64(True):
        draws = poisson(jax.random.PRNGKey(0), jnp.full(1000, 5.0))
        assert draws.dtype == jnp.float64
