"""The search without a gradient: it finds, and it ends."""

import math

import numpy as np
import pytest
from helpers.clocks import Ticking

from mdpo_rddl.auto.search.cma import Adaptation, Sampling

TARGET = np.array([1.0, -2.0, 0.5])


def distance(iteration: int, candidates: np.ndarray) -> np.ndarray:
    del iteration
    return -np.sum((candidates - TARGET) ** 2, axis=1)


def adaptation(iterations: float = 300, **values) -> tuple[Adaptation, float]:
    """An adaptation by a clock that ticks once an iteration, and when so many are over."""
    sampling = Sampling(**({"sigma": 0.5, "population": 16, "seed": 1} | values))
    return Adaptation(np.zeros(3), sampling, Ticking()), iterations + 0.5


def adapted(evaluate=distance, iterations: float = 300, **values) -> Adaptation:
    made, until = adaptation(iterations, **values)
    made.run(evaluate, until)
    return made


@pytest.mark.parametrize("separable", [False, True])
def test_it_finds_the_best_weights(separable):
    result = adapted(separable=separable)
    np.testing.assert_allclose(result.mean, TARGET, atol=1e-3)
    assert result.iterations > 10


def test_candidates_whose_return_is_no_number_lose():
    def broken(iteration, candidates):
        returns = distance(iteration, candidates)
        return np.where(candidates[:, 1] < -3.0, np.nan, returns)

    np.testing.assert_allclose(adapted(broken).mean, TARGET, atol=1e-3)


def test_it_ends_in_time_and_goes_on_from_there():
    one, until = adaptation(30, separable=True)
    one.run(distance, until)
    assert one.iterations == 30
    assert not one.converged
    one.run(distance, until + 31.0)
    assert one.iterations == 60
    at_once = adapted(iterations=60, separable=True)
    np.testing.assert_array_equal(one.mean, at_once.mean)
    assert np.any(at_once.mean != adapted(iterations=30, separable=True).mean)


def test_it_ends_where_nothing_makes_a_difference():
    calls = []

    def flat(iteration, candidates):
        calls.append(iteration)
        return np.zeros(len(candidates))

    made = adapted(flat, math.inf, separable=True, patience=7)
    assert calls == list(range(7))
    assert made.converged


def test_the_same_seed_finds_the_same():
    one, two = adapted(iterations=20), adapted(iterations=20)
    np.testing.assert_array_equal(one.mean, two.mean)
    assert np.any(adapted(iterations=20, seed=2).mean != one.mean)


def test_it_is_left_once_it_gains_little():
    near = adapted(least_gain=0.01)
    assert near.converged
    assert 60 <= near.iterations < 200
    np.testing.assert_allclose(near.mean, TARGET, atol=0.2)
    assert adapted().iterations > near.iterations


def test_first_returns_that_are_no_numbers_are_no_gain():
    def rising(iteration, candidates):
        if not iteration:
            return np.full(len(candidates), np.nan)
        return iteration + distance(iteration, candidates)

    made = adapted(rising, iterations=100, separable=True, least_gain=0.01)
    assert made.iterations == 100


def test_it_is_not_left_while_it_gains():
    def rising(iteration, candidates):
        return iteration + distance(iteration, candidates)

    made = adapted(rising, iterations=100, separable=True, least_gain=0.01)
    assert made.iterations == 100
    assert not made.converged
