"""Covariance matrix adaptation, against the package cmaes and functions whose best is known."""

import warnings

import numpy as np
import pytest

from mdpo_rddl.race.cma import ask, begin, is_over, tell

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    cmaes = pytest.importorskip("cmaes")

POPULATION = 12


def rosenbrock(vectors):
    ahead, here = vectors[:, 1:], vectors[:, :-1]
    return -np.sum(100.0 * (ahead - here**2) ** 2 + (1.0 - here) ** 2, axis=1)


@pytest.mark.parametrize("is_full", [True, False])
def test_the_same_vectors_are_the_same_update_as_in_cmaes(is_full):
    random, start = np.random.default_rng(0), np.array([0.5, -1.0, 2.0, 0.0, 0.3])
    kind = cmaes.CMA if is_full else cmaes.SepCMA
    theirs = kind(mean=start.copy(), sigma=0.3, population_size=POPULATION, seed=1)
    ours = begin(start, 0.3, is_full)
    for _ in range(60):
        vectors = ask(ours, POPULATION, random)
        returns = rosenbrock(vectors)
        theirs._eigen_decomposition()  # as asking does
        theirs.tell(list(zip(vectors, -returns, strict=True)))
        ours = tell(ours, vectors, returns)
        np.testing.assert_allclose(ours.mean, theirs.mean, rtol=1e-9, atol=1e-12)
        assert ours.sigma == pytest.approx(theirs._sigma, rel=1e-9)
        matrix = np.diag(ours.scales**2)
        if is_full:
            matrix = (ours.axes * ours.scales**2) @ ours.axes.T
        wanted = theirs._C if is_full else np.diag(theirs._C)
        np.testing.assert_allclose(matrix, wanted, rtol=1e-8, atol=1e-10)
    assert is_over(ours) == theirs.should_stop()


def ellipsoid(vectors):
    return -np.sum(10.0 ** np.arange(4) * (vectors - 1.0) ** 2, axis=1)


@pytest.mark.parametrize(("is_full", "function"), [(True, rosenbrock), (False, ellipsoid)])
def test_it_finds_the_best_of_a_curved_and_of_a_narrow_valley(is_full, function):
    random, search = np.random.default_rng(1), begin(np.zeros(4), 0.5, is_full)
    for _ in range(250):
        vectors = ask(search, POPULATION, random)
        search = tell(search, vectors, function(vectors))
    np.testing.assert_allclose(search.mean, 1.0, atol=1e-3)


def test_a_state_is_not_changed_and_vectors_are_of_its_law():
    search = begin(np.array([1.0, -2.0]), 0.5, True)
    vectors = ask(search, 40_000, np.random.default_rng(0))
    np.testing.assert_allclose(vectors.mean(axis=0), search.mean, atol=0.02)
    np.testing.assert_allclose(np.cov(vectors.T), 0.25 * np.eye(2), atol=0.02)
    before = [np.copy(each) for each in search if isinstance(each, np.ndarray)]
    moved = tell(search, vectors[:8], vectors[:8, 0])
    assert moved.generation == 1
    after = [each for each in search if isinstance(each, np.ndarray)]
    for one, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    "changes", [{"sigma": 1e-20}, {"sigma": 1e9}, {"scales": np.array([1.0, 1e-9])}]
)
def test_a_law_without_a_future_is_over(changes):
    search = begin(np.array([1.0, -2.0]), 0.5, True)
    assert not is_over(search)
    assert is_over(search._replace(**changes))
