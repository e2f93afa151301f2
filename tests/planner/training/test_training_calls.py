"""Training in calls of several iterations."""

import contextlib
import itertools
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from helpers.problems import assert_same_bits
from helpers.trainings import FOREVER, KEY, paper_config, reservoir

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.training import first_iteration, training
from mdpo_rddl.planner.training.training import Progress, train
from mdpo_rddl.planner.update.sizes import CallSizes


@pytest.fixture(scope="module")
def planner() -> Built[MDPOPlanner]:
    return build_planner(reservoir(), paper_config())


@pytest.fixture(scope="module")
def calling_planner() -> Built[MDPOPlanner]:
    values = {"iterations_per_call": 20, "test_every": 5}
    return build_planner(reservoir(), paper_config().with_section("MDPO", values))


@pytest.mark.long
def test_calls_train_as_single_iterations_do(planner, calling_planner):
    single = train(planner, KEY, Budget(155, FOREVER))
    calls = train(calling_planner, KEY, Budget(155, FOREVER))
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
    wild = build_planner(reservoir(), config.with_section("Noise", {"method": "NoNoise"}))
    wild = wild.with_arguments(test_rolling_window=1)
    result = train(wild, KEY, Budget(1200, FOREVER))
    best = max(result.history, key=lambda record: record.test_return)
    assert result.history[0].iteration == 19
    assert result.best_iteration % 5 == 4
    assert result.best_iteration < best.iteration


@pytest.mark.parametrize(
    ("most", "sizes"), [(1000.0, (20, 5)), (14.9, (10, 5)), (3.3, (3, 3)), (0.1, (1, 1))]
)
def test_calls_of_a_slow_model_are_shorter(most, sizes):
    assert CallSizes(20, 5).bounded(most) == CallSizes(*sizes)


def test_the_sizes_of_a_call_are_changed_for_a_block(calling_planner):
    planner = calling_planner.planner

    def sizes() -> tuple[int, int]:
        return planner.iterations_per_call, planner.test_every

    with planner.call_sizes(6, 3):
        assert sizes() == (6, 3)
        planner.bound_calls(2.0)
        assert sizes() == (2, 2)
    assert sizes() == (20, 5)
    with contextlib.suppress(ZeroDivisionError), planner.call_sizes():
        planner.bound_calls(1.0)
        raise ZeroDivisionError
    assert sizes() == (20, 5)
    with pytest.raises(ValueError, match="must divide"), planner.call_sizes(4):
        pass


@pytest.mark.long
def test_a_slower_machine_finds_the_same_iterates(calling_planner, monkeypatch):
    found = {}
    for tick in (0.001, 0.3):
        clock = itertools.count(0.0, tick)
        passing = SimpleNamespace(perf_counter=lambda clock=clock: next(clock))
        for module in (first_iteration, training):
            monkeypatch.setattr(module, "time", passing)
        calls: list[Progress] = []
        result = train(calling_planner, KEY, Budget(1200, FOREVER), on_progress=calls.append)
        found[len(calls)] = result
    assert list(found) == [60, 240]
    fast, slow = found.values()
    assert fast.best_iteration == slow.best_iteration
    assert_same_bits(fast.best_params, slow.best_params)


@pytest.mark.long
def test_the_seconds_are_kept_by_calls_too(calling_planner):
    result = train(calling_planner, KEY, Budget(10**6, 0.5))
    assert result.status == "time_budget_reached"
    assert result.train_seconds >= 0.5
    assert np.isfinite(result.history[-1].test_return)
