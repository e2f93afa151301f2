"""The law of the noise: its distribution, its scale and its independence."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from mdpo_rddl.noise.actions import ActionKind, ActionSpec
from mdpo_rddl.noise.draws import draw_perturbation, unit_noise, zero_perturbation


def spec(name: str, shape: tuple[int, ...], kind: ActionKind = ActionKind.REAL) -> ActionSpec:
    bound = np.zeros(shape)
    return ActionSpec(name, shape, kind, bound, bound)


SPECS = {"heat": spec("heat", (3,)), "fan": spec("fan", (2, 2)), "one": spec("one", ())}


@pytest.mark.parametrize(
    ("kind", "law"),
    [
        (ActionKind.REAL, stats.norm),
        (ActionKind.INTEGER, stats.norm),
        (ActionKind.BOOL, stats.logistic),
    ],
)
def test_unit_noise_has_the_exact_law(kind, law):
    sample = unit_noise(jax.random.PRNGKey(1), kind, (20_000,), jnp.float32)
    assert stats.kstest(np.asarray(sample), law.cdf).pvalue > 1e-3


def test_perturbation_is_sigma_times_unit_noise():
    sigma = jnp.array([0.0, 0.5, 2.0])
    key = jax.random.PRNGKey(2)
    unit = draw_perturbation(key, jnp.ones(3), SPECS, 5, jnp.float32)
    scaled = draw_perturbation(key, sigma, SPECS, 5, jnp.float32)
    for name, action in SPECS.items():
        assert unit[name].shape == (5, 3, *action.shape)
        scale = np.reshape(sigma, (1, 3) + (1,) * len(action.shape))
        np.testing.assert_array_equal(scaled[name], unit[name] * scale)


def test_standardised_perturbations_are_standard_normal_at_every_step():
    sigma = jnp.array([0.1, 1.0, 30.0])
    draw = draw_perturbation(jax.random.PRNGKey(3), sigma, SPECS, 4000, jnp.float32)
    for values in draw.values():
        for t in range(3):
            standard = np.ravel(values[:, t]) / sigma[t]
            assert stats.kstest(standard, stats.norm.cdf).pvalue > 1e-3


def test_noise_is_independent_over_steps_components_and_tensors():
    batch = 20_000
    draw = draw_perturbation(jax.random.PRNGKey(4), jnp.ones(2), SPECS, batch, jnp.float32)
    columns = np.concatenate([np.reshape(v, (batch, -1)) for v in draw.values()], axis=1)
    correlation = np.corrcoef(columns.T) - np.eye(columns.shape[1])
    # the largest of 120 correlations of 20,000 pairs has standard error 0.007
    assert np.abs(correlation).max() < 0.035


def test_keys_of_different_restarts_give_independent_noise():
    keys = jax.random.split(jax.random.PRNGKey(5), 2)
    sigma = jnp.ones(10)
    a, b = (np.ravel(draw_perturbation(k, sigma, SPECS, 500, jnp.float32)["fan"]) for k in keys)
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.04
    assert stats.ks_2samp(a, b).pvalue > 1e-3


def test_a_tensor_keeps_its_noise_whatever_the_order_of_the_others():
    key = jax.random.PRNGKey(6)
    forward = draw_perturbation(key, jnp.ones(4), SPECS, 2, jnp.float32)
    reverse = draw_perturbation(key, jnp.ones(4), dict(reversed(SPECS.items())), 2, jnp.float32)
    for name in SPECS:
        np.testing.assert_array_equal(forward[name], reverse[name])


def test_zero_perturbation_matches_the_shapes_of_a_draw():
    zero = zero_perturbation(4, SPECS, 2, jnp.float32)
    drawn = draw_perturbation(jax.random.PRNGKey(0), jnp.ones(4), SPECS, 2, jnp.float32)
    assert jax.tree.map(jnp.shape, zero) == jax.tree.map(jnp.shape, drawn)
    assert all(not np.any(value) for value in zero.values())
