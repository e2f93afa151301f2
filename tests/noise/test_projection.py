"""Projection after noise: always in the box, the identity inside it, gradients alive."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import special

from mdpo_rddl.noise.actions import ActionKind, ActionSpec
from mdpo_rddl.noise.projection import (
    clip_to_box,
    perturb_and_project,
    project_and_perturb,
    shift_logit,
    squash_to_box,
)

INF = np.inf
LOWER = np.array([0.0, 0.05, -INF, -INF])
UPPER = np.array([6.0, INF, 1.5, INF])
BOX = ActionSpec("a", (4,), ActionKind.REAL, LOWER, UPPER)


def test_clip_is_the_identity_inside_and_the_bound_outside():
    inside = jnp.array([2.0, 7.0, -3.0, 100.0])
    np.testing.assert_array_equal(clip_to_box(inside, BOX), inside)
    below = clip_to_box(jnp.full(4, -9.0), BOX)
    np.testing.assert_array_equal(below, np.array([0.0, 0.05, -9.0, -9.0], np.float32))
    above = clip_to_box(jnp.full(4, 9.0), BOX)
    np.testing.assert_array_equal(above, np.array([6.0, 9.0, 1.5, 9.0], np.float32))


def test_clip_keeps_the_whole_gradient_on_a_bound_and_none_outside():
    gradient = jax.grad(lambda x: jnp.sum(clip_to_box(x, BOX)))
    on_bound = jnp.array([0.0, 0.05, 1.5, 0.0])
    assert gradient(on_bound).tolist() == [1.0] * 4
    outside = jnp.array([-0.1, 0.0, 1.6, 5.0])
    assert gradient(outside).tolist() == [0.0, 0.0, 0.0, 1.0]


def test_a_perturbation_restores_a_clipped_gradient():
    """Why the noise enters ahead of the projection."""

    def through(raw, shift):
        return jnp.sum(perturb_and_project({"a": raw}, {"a": shift}, {"a": BOX})["a"])

    raw = jnp.array([-2.0, -2.0, 3.0, 0.0])
    silent = jax.grad(through)(raw, jnp.zeros(4))
    woken = jax.grad(through)(raw, jnp.array([4.0, 4.0, -4.0, 0.0]))
    assert silent.tolist() == [0.0, 0.0, 0.0, 1.0]
    assert woken.tolist() == [1.0] * 4


def test_a_perturbation_behind_the_projection_wakes_nothing():
    def through(raw, shift):
        return jnp.sum(project_and_perturb({"a": raw}, {"a": shift}, {"a": BOX})["a"])

    raw, shift = jnp.array([-2.0, -2.0, 3.0, 0.0]), jnp.array([4.0, 4.0, -4.0, 0.0])
    assert through(raw, shift) == pytest.approx(4.0 + 4.05 - 2.5)
    assert jax.grad(through)(raw, shift).tolist() == [0.0, 0.0, 0.0, 1.0]
    # with respect to the perturbation there is one, even on the bound
    assert jax.grad(through, 1)(raw, jnp.zeros(4)).tolist() == [1.0] * 4
    # inside the box the two are the same
    inside = jnp.array([2.0, 2.0, 1.0, 0.0])
    assert through(inside, jnp.full(4, 0.1)) == pytest.approx(5.4)


def test_a_bool_is_perturbed_on_its_log_odds_behind_the_projection_too():
    spec = ActionSpec("b", (), ActionKind.BOOL, np.nan, np.nan)
    arguments = {"b": jnp.array(0.3)}, {"b": jnp.array(1.5)}, {"b": spec}
    late, early = project_and_perturb(*arguments)["b"], perturb_and_project(*arguments)["b"]
    assert late == pytest.approx(float(early), rel=1e-6)


@pytest.mark.parametrize("scale", [0.1, 10.0, 1e4])
def test_every_projected_action_is_in_its_box(scale):
    shape = (2000, 4)
    raw, shift = scale * jax.random.normal(jax.random.PRNGKey(0), (2, *shape))
    for spec in (BOX, ActionSpec("a", (4,), ActionKind.REAL, LOWER, UPPER, squashed=True)):
        action = perturb_and_project({"a": raw}, {"a": shift}, {"a": spec})["a"]
        assert np.all(np.isfinite(action))
        assert np.all(action >= LOWER.astype(np.float32))
        assert np.all(action <= UPPER.astype(np.float32))


def test_squash_is_monotone_and_centred():
    values = squash_to_box(jnp.zeros(4), BOX)
    np.testing.assert_allclose(values, [3.0, 0.05 + np.log(2.0), 1.5 - np.log(2.0), 0.0], rtol=1e-6)
    slopes = jax.vmap(jax.grad(lambda x, i: squash_to_box(x, BOX)[i]), in_axes=(None, 0))(
        jnp.array([0.3, -2.0, 1.0, 4.0]), jnp.arange(4)
    )
    assert np.all(np.diag(slopes) > 0.0)


def test_shifted_log_odds():
    probability = np.array([0.01, 0.3, 0.5, 0.999])
    for shift in (-3.0, -0.2, 0.7, 5.0):
        expected = special.expit(special.logit(probability) + shift)
        moved = shift_logit(jnp.asarray(probability, jnp.float32), jnp.float32(shift))
        np.testing.assert_allclose(moved, expected, rtol=2e-5)


def test_shifted_log_odds_stay_probabilities_with_finite_gradients():
    probability = jnp.array([0.0, 1e-38, 0.4, 1.0 - 1e-7, 1.0])
    for shift in (-1e4, -90.0, 0.0, 90.0, 1e4):
        shifts = jnp.full(5, shift)
        moved = shift_logit(probability, shifts)
        assert np.all((moved >= 0.0) & (moved <= 1.0))
        for argument in (0, 1):
            gradient = jax.grad(lambda *x: jnp.sum(shift_logit(*x)), argument)(probability, shifts)
            assert np.all(np.isfinite(gradient)), (shift, argument)


def test_a_zero_shift_returns_the_probability_and_the_logit_s_gradient():
    probability = jnp.array([0.1, 0.123456, 0.7])
    zero = jnp.zeros(3)
    np.testing.assert_allclose(shift_logit(probability, zero), probability, rtol=2e-7)
    direct, by_shift = jax.grad(lambda *x: jnp.sum(shift_logit(*x)), (0, 1))(probability, zero)
    np.testing.assert_allclose(direct, np.ones(3), rtol=1e-6)
    np.testing.assert_allclose(by_shift, probability * (1.0 - probability), rtol=1e-6)


def test_fluents_without_a_perturbation_pass_untouched():
    raw = {"a": jnp.full(4, 99.0), "b": jnp.full(4, 99.0)}
    actions = perturb_and_project(raw, {"a": jnp.zeros(4)}, {"a": BOX})
    assert actions["b"] is raw["b"]
