"""The quantile of the sensitivities, and what the rules make of it, on random profiles."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdpo_rddl.noise import AdaptiveNoise, ConstantNoise
from mdpo_rddl.noise.sensitivity import normalised_sensitivity, step_sensitivity

STEPS = 7
TINY = np.finfo(np.float32).tiny
# below the smallest normal number, which JAX may flush to 0
DENORMALS = st.sampled_from([TINY / 2, TINY / 1024])
ORDINARY = st.floats(np.float32(1e-30), np.float32(1e30), width=32)
NOT_FINITE = st.sampled_from([np.nan, np.inf])
FINITE = st.one_of(st.just(0.0), ORDINARY, DENORMALS)
QUANTILES = st.floats(0.015625, 1.0, width=32)


def profiles(values):
    return st.lists(values, min_size=STEPS, max_size=STEPS).map(np.float32)


@given(profiles(st.one_of(FINITE, NOT_FINITE)), QUANTILES)
def test_the_quantile_is_numpy_s_over_what_is_finite(s, p):
    found = np.asarray(normalised_sensitivity(jnp.asarray(s), p, 1e-8))
    finite = np.isfinite(s)
    expected = np.zeros(STEPS)
    if finite.any():
        reference = np.quantile(s[finite].astype(np.float64), p)
        expected[finite] = np.clip(s[finite] / (reference + 1e-8), 0.0, 1.0)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6)


RULES = st.builds(
    lambda low, span, alpha, p: AdaptiveNoise(low, low + span, alpha, p),
    st.floats(0.0, 5.0),
    st.floats(0.0, 20.0),
    st.floats(0.0625, 8.0),
    QUANTILES,
)


def sigma_of(rule, s):
    """The profile where the norm of the gradient is s."""
    profile, _ = rule.profile({"a": jnp.asarray(s)[:, np.newaxis]}, (), STEPS)
    return np.asarray(profile.sigma)


@given(RULES, profiles(st.one_of(FINITE, NOT_FINITE)))
def test_sigma_stays_between_its_bounds(rule, s):
    sigma = sigma_of(rule, s)
    assert sigma.shape == (STEPS,)
    slack = 1e-6 * rule.sigma_max
    assert np.all(sigma >= rule.sigma_min - slack)
    assert np.all(sigma <= rule.sigma_max + slack)
    np.testing.assert_allclose(sigma[~np.isfinite(s)], rule.sigma_min, rtol=1e-5, atol=1e-6)


@given(RULES, profiles(FINITE))
def test_a_more_sensitive_step_never_gets_less_noise(rule, s):
    sigma = sigma_of(rule, s)[np.argsort(s)]
    assert np.all(np.diff(sigma) >= -1e-6 * rule.sigma_max)


@given(RULES, profiles(st.one_of(FINITE, NOT_FINITE)), st.permutations(range(STEPS)))
def test_the_order_of_the_steps_is_the_order_of_the_noise(rule, s, order):
    np.testing.assert_array_equal(sigma_of(rule, s[order]), sigma_of(rule, s)[order])


@given(profiles(st.floats(-(2**66), 2**66, width=32)), st.integers(-20, 20))
def test_the_sensitivity_scales_with_the_gradient(gradient, power):
    rows = jnp.asarray(gradient)[:, np.newaxis] * jnp.ones(3)
    one, other = (np.asarray(step_sensitivity({"a": scale * rows})) for scale in (1.0, 2.0**power))
    np.testing.assert_allclose(other, one * 2.0**power, rtol=1e-5, atol=1e-30)
    np.testing.assert_allclose(one, np.abs(gradient) * np.sqrt(3.0), rtol=1e-5, atol=1e-30)


@given(st.floats(0.0, 1e6), st.integers(1, 9))
def test_constant_noise_is_the_same_at_each_step(sigma, horizon):
    profile, _ = ConstantNoise(sigma).profile(None, (), horizon)
    assert profile.sigma.shape == (horizon,)
    assert np.asarray(profile.sigma) == pytest.approx(sigma, rel=1e-6)
