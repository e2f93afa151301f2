"""Parameter exploration on returns that are known."""

import numpy as np
import pytest
from helpers.clocks import Ticking

from mdpo_rddl.auto.search.pgpe import Exploring, ParameterExploration, _ranks

GOAL = np.array([3.0, -2.0, 0.5, 0.0])


def near_the_goal(iteration, samples):
    return -np.sum((samples - GOAL) ** 2, axis=1)


def exploration(**values) -> ParameterExploration:
    return ParameterExploration(np.zeros(4), Exploring(**values), Ticking())


def test_the_mean_moves_to_where_returns_are_large_and_can_be_gone_on_with():
    one = exploration()
    one.run(near_the_goal, until=100.0)
    half_way = np.linalg.norm(one.mean - GOAL)
    assert half_way < np.linalg.norm(GOAL)
    one.run(near_the_goal, until=600.0)
    assert np.linalg.norm(one.mean - GOAL) < 0.3 < half_way
    assert one.iterations > 500


def test_the_best_sample_is_kept():
    seen = []

    def noting(iteration, samples):
        returns = near_the_goal(iteration, samples)
        seen.extend(zip(returns, samples, strict=True))
        return returns

    one = exploration(seed=2)
    one.run(noting, until=40.0)
    best_return, best = max(seen, key=lambda pair: pair[0])
    assert one.best_return == best_return
    np.testing.assert_array_equal(one.best, best)


def test_where_all_returns_are_equal_the_mean_stays():
    one = exploration()
    one.run(lambda iteration, samples: np.ones(len(samples)), until=20.0)
    np.testing.assert_array_equal(one.mean, np.zeros(4))


def test_samples_are_symmetric_and_what_is_not_finite_is_worst():
    batches = []

    def half_broken(iteration, samples):
        batches.append(samples)
        return np.where(samples[:, 0] > 0, np.nan, 1.0)

    one = exploration(sigma=0.5, pairs=3)
    one.run(half_broken, until=0.0)
    (samples,) = batches
    np.testing.assert_allclose(samples[:3], -samples[3:])
    # away from the broken half
    assert one.mean[0] < 0.0
    assert one.best[0] <= 0.0


def test_the_best_sample_is_that_of_the_latest_run():
    one = exploration()
    one.run(near_the_goal, until=100.0)
    one.run(lambda iteration, samples: near_the_goal(iteration, samples) - 1e6, until=110.0)
    assert one.best_return < -9e5


def test_narrowing_goes_on_around_a_vector():
    one, batches = exploration(sigma=1.0, pairs=500), []
    one.run(near_the_goal, until=0.0)
    one.narrow(0.25, GOAL)
    np.testing.assert_array_equal(one.mean, GOAL)

    def noting(iteration, samples):
        batches.append(samples - one.mean)
        return near_the_goal(iteration, samples)

    one.run(noting, until=0.0)
    assert np.std(batches[0]) == pytest.approx(0.25, rel=0.1)


def test_ranks():
    assert _ranks(np.array([5.0, -np.inf, 7.0])).tolist() == [0.0, -0.5, 0.5]
    assert _ranks(np.array([1.0, 1.0, 2.0])).tolist() == [-0.25, -0.25, 0.5]
