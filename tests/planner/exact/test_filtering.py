"""The particle filter: weights worked by hand, what is kept where none matches."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.lakes import preset
from helpers.toys import toy

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.exact.filtering import ParticleFilter, kernel, resampled
from mdpo_rddl.planner.exact.likelihood import LEAST, Likelihood

KEY = jax.random.PRNGKey(0)
COUNT = 4096
NOTHING = {"act": np.bool_(False)}


@functools.cache
def planner(name, **words):
    return build_planner(toy(name, **words), preset(1.0).without_section("Search")).planner


@pytest.fixture(scope="module")
def gauges():
    particle_filter = ParticleFilter(planner("gauges"))
    return particle_filter, particle_filter.advance


def gauged(measured, guessed, told, shown=(False, False, False)):
    return {
        "measured": np.float32(measured),
        "guessed": np.float32(guessed),
        "told": np.array(told),
        "shown": np.array(shown),
    }


def test_likelihoods_are_those_that_the_model_states():
    likelihood = Likelihood(planner("gauges").test_compiled)
    assert likelihood.kernels == ["guessed"]
    after = {
        "height'": jnp.float32(1.0),
        "is-open'": jnp.array([True, False, False]),
        "is-fixed'": jnp.array([True, False, True]),
        **{name: jnp.asarray(value) for name, value in gauged(0.0, 3.0, [True] * 3).items()},
    }
    seen = gauged(2.5, 5.0, [True, True, False], [True, True, True])
    known, distances = likelihood(after, seen)
    normal = -0.5 * 1.5**2 - 0.5 * math.log(2.0 * math.pi)
    expected = [normal, *np.log([0.9, 0.2, 0.8]), 0.0, LEAST, 0.0]
    np.testing.assert_allclose(known, expected, rtol=1e-5)
    # of a law that is not read, what was seen less what was drawn
    assert {name: float(value) for name, value in distances.items()} == {"guessed": 2.0}


def test_particles_have_the_posterior_s_moments(gauges):
    particle_filter, advance = gauges
    seen = gauged(2.0, 1.0, [True, True, False])
    found = advance(KEY, particle_filter.start(COUNT), NOTHING, seen)
    assert bool(found.matches)
    assert 1.0 < float(found.effective) < COUNT
    # two measurements of variance 1 and a prior of variance 4
    precision = 1.0 / 4.0 + 1.0 + 1.0
    height = np.asarray(found.particles["height"])
    assert height.mean() == pytest.approx((2.0 + 1.0) / precision, abs=0.15)
    assert height.var() == pytest.approx(1.0 / precision, abs=0.15)
    shares = np.asarray(found.particles["is-open"]).mean(axis=0)
    np.testing.assert_allclose(shares, [0.9 / 1.1, 0.9 / 1.1, 0.1 / 0.9], atol=0.05)


def test_where_nothing_matches_the_nearest_are_kept(gauges):
    particle_filter, advance = gauges
    start, fixed = particle_filter.start(COUNT), np.zeros((COUNT, 3), bool)
    fixed[:, 1] = np.arange(COUNT) < COUNT // 2
    start["is-fixed"] = jnp.asarray(fixed)
    none = advance(KEY, start, NOTHING, gauged(0.0, 0.0, [True] * 3, [True, True, False]))
    # nobody has the first valve fixed; half of them have the second
    assert not bool(none.matches)
    assert np.asarray(none.particles["is-fixed"])[:, 1].all()
    some = advance(KEY, start, NOTHING, gauged(0.0, 0.0, [True] * 3, [False, True, False]))
    assert bool(some.matches)


def test_resampling_is_systematic():
    weights = jnp.array([0.5, 0.0, 0.3, 0.2])
    for seed in range(10):
        counts = np.bincount(resampled(jax.random.PRNGKey(seed), weights), minlength=4)
        assert counts[0] == 2
        assert counts[1] == 0
        assert set(counts[2:].tolist()) <= {0, 1, 2}
    many = np.bincount(resampled(KEY, jnp.tile(weights / 100, 100)), minlength=400)
    assert np.abs(many - 400 * np.tile(weights / 100, 100)).max() <= 1.0


def test_the_kernel_is_silverman_s():
    distances = jnp.array([-1.0, 1.0, 3.0, 5.0])
    width = 1.06 * math.sqrt(5.0) * 4**-0.2
    expected = -0.5 * np.square(np.array(distances) / width)
    np.testing.assert_allclose(kernel(distances)[:, 0], expected, rtol=1e-5)
    # where all agree, what is seen need only be the same up to rounding
    assert kernel(jnp.full(4, 1e-6)).min() > -0.1


def test_a_particle_that_is_not_finite_leaves_the_others_their_weights():
    distances = np.array([[-1.0, 1.0], [1.0, np.inf], [3.0, 2.0], [np.nan, 3.0]])
    logs = np.asarray(kernel(jnp.asarray(distances)))
    assert np.all(logs[~np.isfinite(distances)] == LEAST)
    for place in range(2):
        finite = np.isfinite(distances[:, place])
        width = 1.06 * np.std(distances[finite, place]) * 4**-0.2
        expected = -0.5 * np.square(distances[finite, place] / width)
        np.testing.assert_allclose(logs[finite, place], expected, rtol=1e-5)
    assert np.all(kernel(jnp.full(4, jnp.nan)) == LEAST)


def test_a_normal_law_without_variance_is_met_by_its_mean_alone():
    likelihood = Likelihood(planner("gauges", **{"height', 1.0": "height', 0.0"}).test_compiled)
    after = {
        "height'": jnp.float32(1.5),
        "is-open'": jnp.zeros(3, bool),
        "is-fixed'": jnp.zeros(3, bool),
        **{name: jnp.asarray(value) for name, value in gauged(0.0, 3.0, [False] * 3).items()},
    }
    for measured, is_met in ((1.5, True), (1.5 + 1e-6, True), (1.6, False)):
        known, _ = likelihood(after, gauged(measured, 5.0, [False] * 3))
        assert (float(known[0]) > 0.0) == is_met
        assert (float(known[0]) == LEAST) != is_met
