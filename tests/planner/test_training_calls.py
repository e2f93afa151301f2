"""Training in calls of several iterations."""

import itertools
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from helpers.problems import assert_same_bits
from helpers.trainings import FOREVER, KEY, paper_config, reservoir

from mdpo_rddl.planner import training
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.training import Progress, bound_calls, train


@pytest.fixture(scope="module")
def planner() -> MDPOPlanner:
    return build_planner(reservoir(), paper_config())[0]


@pytest.fixture(scope="module")
def calling_planner() -> MDPOPlanner:
    values = {"iterations_per_call": 20, "test_every": 5}
    return build_planner(reservoir(), paper_config().with_section("MDPO", values))[0]


def test_calls_train_as_single_iterations_do(planner, calling_planner):
    single = train(planner, key=KEY, iterations=155, seconds=FOREVER)
    calls = train(calling_planner, key=KEY, iterations=155, seconds=FOREVER)
    assert (calls.iterations, calls.status) == (155, single.status)
    for one, other in zip(
        jax.tree.leaves(calls.last_params), jax.tree.leaves(single.last_params), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-4)
    # short enough for 60 points
    assert [record.iteration for record in calls.history] == [*range(1, 154, 2), 154]


def test_the_best_iterate_may_lie_within_a_call():
    values = {"iterations_per_call": 20, "test_every": 5}
    config = paper_config(optimizer_kwargs={"learning_rate": 50.0}).with_section("MDPO", values)
    wild, _ = build_planner(reservoir(), config.with_section("Noise", {"method": "NoNoise"}))
    window = {"test_rolling_window": 1}
    result = train(wild, key=KEY, iterations=1200, seconds=FOREVER, optimize_kwargs=window)
    best = max(result.history, key=lambda record: record.test_return)
    assert result.history[0].iteration == 19
    assert result.best_iteration % 5 == 4
    assert result.best_iteration < best.iteration


@pytest.mark.parametrize(
    ("most", "sizes"), [(1000.0, (20, 5)), (14.9, (10, 5)), (3.3, (3, 3)), (0.1, (1, 1))]
)
def test_calls_of_a_slow_model_are_shorter(most, sizes):
    slow = SimpleNamespace(iterations_per_call=20, test_every=5)
    bound_calls(slow, most)
    assert (slow.iterations_per_call, slow.test_every) == sizes


def test_a_slower_machine_finds_the_same_iterates(calling_planner, monkeypatch):
    found = {}
    for tick in (0.001, 0.3):
        clock = itertools.count(0.0, tick)
        passing = SimpleNamespace(perf_counter=lambda clock=clock: next(clock))
        monkeypatch.setattr(training, "time", passing)
        calls: list[Progress] = []
        result = train(
            calling_planner, key=KEY, iterations=1200, seconds=FOREVER, on_progress=calls.append
        )
        found[len(calls)] = result
    assert list(found) == [60, 240]
    fast, slow = found.values()
    assert fast.best_iteration == slow.best_iteration
    assert_same_bits(fast.best_params, slow.best_params)


def test_the_seconds_are_kept_by_calls_too(calling_planner):
    result = train(calling_planner, key=KEY, iterations=10**6, seconds=0.5)
    assert result.status == "time_budget_reached"
    assert 0.5 <= result.train_seconds < 2.0
    assert np.isfinite(result.history[-1].test_return)
