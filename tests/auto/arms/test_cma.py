"""The search without a gradient: it finds, and it ends."""

import time

import numpy as np
import pytest

from mdpo_rddl.auto.arms.cma import search

TARGET = np.array([1.0, -2.0, 0.5])


def distance(iteration: int, candidates: np.ndarray) -> np.ndarray:
    del iteration
    return -np.sum((candidates - TARGET) ** 2, axis=1)


def run(evaluate=distance, seconds: float = 20.0, **arguments):
    arguments = {"sigma": 0.5, "population": 16, "seed": 1, "separable": False} | arguments
    return search(evaluate, np.zeros(3), until=time.monotonic() + seconds, **arguments)


@pytest.mark.parametrize("separable", [False, True])
def test_it_finds_the_best_weights(separable):
    result = run(separable=separable, seconds=3.0 if separable else 20.0)
    np.testing.assert_allclose(result.mean, TARGET, atol=1e-3)
    assert result.iterations > 10


def test_candidates_whose_return_is_no_number_lose():
    def broken(iteration, candidates):
        returns = distance(iteration, candidates)
        return np.where(candidates[:, 1] < -3.0, np.nan, returns)

    result = run(broken)
    np.testing.assert_allclose(result.mean, TARGET, atol=1e-3)


def test_it_ends_in_time():
    started = time.monotonic()
    run(separable=True, seconds=0.3)
    assert time.monotonic() - started < 5.0


def test_it_ends_where_nothing_makes_a_difference():
    calls = []

    def flat(iteration, candidates):
        calls.append(iteration)
        return np.zeros(len(candidates))

    run(flat, separable=True, patience=7)
    assert calls == list(range(7))


def test_the_same_seed_finds_the_same():
    one, two = (run(patience=5, seconds=20.0) for _ in range(2))
    np.testing.assert_array_equal(one.mean, two.mean)
