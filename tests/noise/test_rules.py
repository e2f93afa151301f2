"""The noise rules: profiles worked by hand, ranges, and their life inside compiled functions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mdpo_rddl.noise import AdaptiveNoise, ConstantNoise, NoNoise
from mdpo_rddl.noise.sensitivity import normalised_sensitivity, step_sensitivity


def profile(noise, gradients):
    gradients = {name: jnp.asarray(value, jnp.float32) for name, value in gradients.items()}
    horizon = len(next(iter(gradients.values())))
    result, state = noise.profile(gradients, noise.initial_state(horizon), horizon)
    assert state == ()
    return np.asarray(result.sigma), np.asarray(result.sensitivity)


def test_sensitivity_is_the_norm_per_step_averaged_over_tensors():
    gradients = {
        "fan": jnp.array([[[3.0, 0.0], [0.0, 4.0]], [[0.0, 0.0], [0.0, 0.0]]]),  # norms 5, 0
        "heat": jnp.array([1.0, -7.0]),  # norms 1, 7
    }
    assert step_sensitivity(gradients).tolist() == [3.0, 3.5]


def test_sensitivity_survives_squares_that_overflow_and_underflow():
    gradients = {"a": jnp.array([[3e30, 4e30], [3e-30, 4e-30]])}
    np.testing.assert_allclose(step_sensitivity(gradients), [5e30, 5e-30], rtol=1e-6)


def test_constant_sensitivity_is_loud_everywhere():
    sigma, sensitivity = profile(AdaptiveNoise(sigma_max=10.0), {"a": np.full((6, 1), 2.0)})
    assert sensitivity.tolist() == [2.0] * 6
    np.testing.assert_allclose(sigma, 10.0, rtol=1e-6)


def test_one_spike_is_alone_loud():
    # the 1.0-quantile is the spike itself, so the others have relative sensitivity 1/4
    gradients = {"a": np.array([1.0, 1.0, 4.0, 1.0])}
    sigma, _ = profile(AdaptiveNoise(1.0, 9.0, alpha=2.0, quantile=1.0), gradients)
    quiet = 9.0 + (1.0 - 9.0) * 0.75**2
    np.testing.assert_allclose(sigma, [quiet, quiet, 9.0, quiet], rtol=1e-6)


def test_quantile_interpolates_and_larger_values_are_clipped():
    # sorted 0 1 2 3 4: the 0.8-quantile lies at position 3.2, so at 3.2
    gradients = {"a": np.array([4.0, 0.0, 3.0, 1.0, 2.0])}
    sigma, _ = profile(AdaptiveNoise(0.0, 10.0, alpha=1.0, quantile=0.8), gradients)
    np.testing.assert_allclose(sigma, 10.0 * np.array([1, 0, 3 / 3.2, 1 / 3.2, 2 / 3.2]), rtol=1e-5)


@pytest.mark.parametrize(("alpha", "expected"), [(0.5, 2.9289322), (1.0, 5.0), (2.0, 7.5)])
def test_alpha_bends_the_map(alpha, expected):
    gradients = {"a": np.array([1.0, 2.0])}
    sigma, _ = profile(AdaptiveNoise(0.0, 10.0, alpha=alpha, quantile=1.0), gradients)
    np.testing.assert_allclose(sigma, [expected, 10.0], rtol=1e-5)


def test_zero_sensitivity_is_quiet_everywhere():
    sigma, _ = profile(AdaptiveNoise(0.5, 1.0), {"a": np.zeros((4, 3))})
    assert sigma.tolist() == [0.5] * 4


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_non_finite_gradient_quiets_its_own_step_only(bad):
    clean = np.array([1.0, 3.0, 4.0, 2.0])
    noise = AdaptiveNoise(0.25, 8.0, alpha=1.0, quantile=0.95)
    dirty = np.insert(clean, 2, bad)
    other = np.ones(5)
    sigma, _ = profile(noise, {"a": dirty, "b": other})
    expected, _ = profile(noise, {"a": clean, "b": np.ones(4)})
    assert sigma[2] == 0.25
    np.testing.assert_array_equal(np.delete(sigma, 2), expected)


def test_only_non_finite_gradients_give_the_quietest_profile():
    sigma, _ = profile(AdaptiveNoise(0.25, 8.0), {"a": np.full(3, np.nan)})
    assert sigma.tolist() == [0.25] * 3


def test_regularization_bounds_the_division():
    relative = normalised_sensitivity(jnp.array([0.0, 1e-3]), 1.0, 1e-3)
    np.testing.assert_allclose(relative, [0.0, 0.5], rtol=1e-6)


def test_constant_and_no_noise():
    assert ConstantNoise(3.0).profile(None, (), 4)[0].sigma.tolist() == [3.0] * 4
    assert NoNoise().profile(None, (), 4)[0].sigma.tolist() == [0.0] * 4


def test_adaptive_noise_without_gradients_is_refused():
    with pytest.raises(ValueError, match="needs the gradients of an analysis"):
        AdaptiveNoise().profile(None, (), 4)


def test_numbers_are_arguments_of_compiled_functions():
    traces = []

    @jax.jit
    def sigma_of(noise, gradients):
        traces.append(noise)
        return noise.profile(gradients, (), 3)[0].sigma

    gradients = {"a": jnp.array([1.0, 2.0, 4.0])}
    for noise in (AdaptiveNoise(0.0, 10.0, 1.0), AdaptiveNoise(1.0, 3.0, 0.5, 0.5)):
        direct = noise.profile(gradients, (), 3)[0].sigma
        np.testing.assert_allclose(sigma_of(noise, gradients), direct, rtol=1e-6)
    assert len(traces) == 1


def test_profiles_vectorise_over_the_rule_itself():
    noises = jax.tree.map(lambda *x: jnp.array(x), AdaptiveNoise(alpha=0.5), AdaptiveNoise(alpha=2))
    gradients = {"a": jnp.array([1.0, 2.0])}
    sigmas = jax.vmap(lambda noise: noise.profile(gradients, (), 2)[0].sigma)(noises)
    for row, alpha in zip(sigmas, (0.5, 2.0), strict=True):
        alone = AdaptiveNoise(alpha=alpha).profile(gradients, (), 2)[0].sigma
        np.testing.assert_allclose(row, alone, rtol=1e-6)


@pytest.mark.parametrize(
    ("rule", "values", "message"),
    [
        (ConstantNoise, {"sigma": -1.0}, "sigma must be at least 0"),
        (ConstantNoise, {"sigma": float("nan")}, "sigma must be finite"),
        (ConstantNoise, {"sigma": "3"}, "sigma must be a number"),
        (ConstantNoise, {"sigma": None}, "sigma must be a number"),
        (AdaptiveNoise, {"sigma_min": -0.1}, "sigma_min must be at least 0"),
        (AdaptiveNoise, {"sigma_min": 2.0, "sigma_max": 1.0}, "sigma_max must be at least 2"),
        (AdaptiveNoise, {"sigma_max": float("inf")}, "sigma_max must be finite"),
        (AdaptiveNoise, {"alpha": 0.0}, "alpha must be above 0"),
        (AdaptiveNoise, {"quantile": 0.0}, "quantile must be above 0"),
        (AdaptiveNoise, {"quantile": 1.1}, "quantile must be at most 1"),
        (AdaptiveNoise, {"regularization": 0.0}, "regularization must be above 0"),
        (AdaptiveNoise, {"analysis_samples": -1}, "analysis_samples must be at least 0"),
        (AdaptiveNoise, {"analysis_samples": 1.5}, "analysis_samples must be an integer"),
    ],
)
def test_numbers_out_of_range_are_refused(rule, values, message):
    with pytest.raises(ValueError, match=message):
        rule(**values)
