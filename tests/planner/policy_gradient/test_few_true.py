"""The law of few true bools, against the sum over all sets."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mdpo_rddl.planner.policy_gradient.few_true import FewTrue

WEIGHTS = np.array([1.0, -0.5, 0.3, -2.0], np.float32)
CASES = [1, 2, 3, 4]


def exact(most: int) -> tuple[np.ndarray, np.ndarray]:
    """All sets, the empty one first, and their probabilities by the definition."""
    sets = [s for s in itertools.product([0, 1], repeat=4) if sum(s) <= most]
    scores = np.exp(np.array(sets) @ WEIGHTS)
    return np.array(sets, bool), scores / np.sum(scores)


@pytest.mark.parametrize("most", CASES)
def test_probabilities_and_entropy_are_those_of_the_sum_over_all_sets(most):
    law, (sets, probabilities) = FewTrue(4, most), exact(most)
    found = jax.vmap(law.log_probability, in_axes=(None, 0))(WEIGHTS, sets)
    np.testing.assert_allclose(np.exp(found), probabilities, rtol=1e-5)
    entropy = -np.sum(probabilities * np.log(probabilities))
    assert float(law.entropy(jnp.asarray(WEIGHTS))) == pytest.approx(entropy, rel=1e-5)


@pytest.mark.parametrize("most", CASES)
def test_sets_are_drawn_as_often_as_they_are_probable(most):
    law, (sets, probabilities) = FewTrue(4, most), exact(most)
    count = 20_000
    noise = law.noise(jax.random.PRNGKey(3), (count,))
    drawn = np.asarray(jax.vmap(law.draw, in_axes=(0, None))(noise, WEIGHTS))
    assert np.max(np.sum(drawn, axis=1)) == most
    places = drawn @ (1 << np.arange(4))
    shares = np.bincount(places, minlength=16)[sets @ (1 << np.arange(4))] / count
    errors = np.sqrt(probabilities * (1.0 - probabilities) / count)
    assert np.all(np.abs(shares - probabilities) < 4.0 * errors)


@pytest.mark.parametrize("most", CASES)
def test_the_likeliest_set_has_the_largest_weights_that_are_positive(most):
    sets, probabilities = exact(most)
    best = np.argsort(-WEIGHTS)[:most]
    expected = np.isin(np.arange(4), best) & (WEIGHTS > 0.0)
    np.testing.assert_array_equal(sets[np.argmax(probabilities)], expected)


def test_more_than_all_are_all_and_none_is_refused():
    assert FewTrue(4, 9).most == 4
    with pytest.raises(ValueError, match="most >= 1"):
        FewTrue(4, 0)
