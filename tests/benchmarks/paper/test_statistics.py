"""The statistics of the paper's table, against figures worked by hand."""

import numpy as np
import pytest
from scipy import stats

from benchmarks.paper.statistics import (
    Interval,
    bootstrap_interval,
    interquartile_mean,
    paired_p,
    stratified_interval,
    within_seed_interval,
)


def test_the_interquartile_mean_leaves_out_a_quarter_at_either_end():
    assert interquartile_mean(np.array([-1e9, 4.0, 2.0, 3.0, 5.0, 1.0, 6.0, 1e9])) == 3.5
    rows = np.array([[0.0, 1.0, 2.0, 90.0], [0.0, 3.0, 5.0, 90.0]])
    assert interquartile_mean(rows, axis=1).tolist() == [1.5, 4.0]


def test_the_bootstrap_interval_of_equal_values_is_a_point():
    assert bootstrap_interval(np.full(20, 7.0)) == Interval(7.0, 7.0)


def test_the_bootstrap_interval_is_the_percentiles_of_resampled_means():
    # of two values, a resample has both of the lower one, both of the higher one, or either
    low, high = bootstrap_interval(np.array([0.0, 1.0]))
    assert (low, high) == (0.0, 1.0)
    values = np.random.default_rng(0).normal(5.0, 1.0, size=400)
    interval = bootstrap_interval(values)
    # the asymptotic error of the 25% trimmed mean of a normal sample, 1.195 / n
    half = 1.96 * np.sqrt(1.195 / 400)
    assert interval.low == pytest.approx(interquartile_mean(values) - half, abs=0.03)
    assert interval.high == pytest.approx(interquartile_mean(values) + half, abs=0.03)


def test_a_stratified_bootstrap_resamples_every_setting_by_itself():
    # all the spread is between the settings, of which a plain bootstrap would see some twice
    scores = np.array([[0.0] * 10, [10.0] * 10])
    assert stratified_interval(scores) == (5.0, Interval(5.0, 5.0))


def test_the_paired_test_by_hand():
    ours, theirs = np.array([2.0, 4.0, 6.0, 8.0]), np.array([1.0, 2.0, 3.0, 4.0])
    # all four signs positive: one of 2^4 equally likely arrangements
    assert paired_p(ours, theirs) == pytest.approx(1 / 16)
    assert paired_p(theirs, ours) == pytest.approx(1.0)


@pytest.mark.parametrize("values", [[1.0], [3.0, 3.0]])
def test_a_paired_test_that_can_say_nothing_says_so(values):
    assert paired_p(np.array(values), np.array(values)) is None


def test_the_interval_of_given_policies_knows_only_the_spread_within_them():
    # the policies differ by 100, which is no error of the mean over just these two
    returns = np.array([[0.0, 2.0], [100.0, 102.0]])
    # variance within 2, of two means of two rollouts: error sqrt((1 + 1) / 4), 2 degrees
    half = stats.t.ppf(0.975, 2) * np.sqrt(0.5)
    assert within_seed_interval(returns) == pytest.approx((51.0 - half, 51.0 + half))
    assert within_seed_interval(np.array([[3.0], [4.0]])) == (-np.inf, np.inf)


def test_intervals_that_share_a_point_overlap():
    assert Interval(0.0, 1.0).overlaps(Interval(1.0, 2.0))
    assert not Interval(0.0, 1.0).overlaps(Interval(1.5, 2.0))
    assert not Interval(1.5, 2.0).overlaps(Interval(0.0, 1.0))
    assert Interval(0.0, 1.0).overlaps(Interval(1.5, 2.0), tolerance=0.5)
