"""Populations on the exact model: how many rollouts each candidate has."""

from typing import ClassVar

import numpy as np
import pytest
from helpers.clocks import Stopped
from helpers.lakes import preset, write_lake

from mdpo_rddl.auto.common.sizes import Size
from mdpo_rddl.planner.config.fitting import without_scales
from mdpo_rddl.auto.search import one_by_one, population
from mdpo_rddl.auto.search.population import PopulationReturns, Wanted, compile_population
from mdpo_rddl.auto.search.weights import weights_of
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.exact.exact import LOST


def refuse(*arguments):
    raise AssertionError("nothing is compiled")


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    lake = write_lake(tmp_path_factory.mktemp("lake"))
    return build_planner(lake, without_scales(preset(1.0))).planner


class Timed:
    """A program takes ten seconds to compile, and a millisecond for each candidate's rollout."""

    compiled: ClassVar[list[int]] = []

    def __init__(self, planner, size, clock, deadline):
        self._clock, self._size, self.seconds = clock, size, 0.001 * size.rollouts
        self.compile_seconds = 10.0
        clock.now += self.compile_seconds
        self.compiled.append(size.rollouts)

    def __call__(self, key, params):
        self._clock.now += self.seconds
        return np.zeros((self._size.population, self._size.rollouts))


@pytest.mark.parametrize(
    ("deadline", "rollout_seconds", "expected"),
    [
        # 500 populations of four rollouts take two seconds, of the 45 that the search has
        (100.0, 0.0, [4]),
        # they do not fit, but another program takes longer than the search
        (13.0, 0.0, [4]),
        # by what a rollout takes the first program would be too slow
        (13.0, 1.0, [1]),
        (100.0, 1e-9, [4]),
    ],
)
def test_no_program_is_compiled_that_is_too_slow(
    planner, monkeypatch, deadline, rollout_seconds, expected
):
    monkeypatch.setattr(population, "_compiled", Timed)
    Timed.compiled.clear()
    clock = Stopped()
    found = compile_population(planner, 0, Wanted(0.5, rollout_seconds), clock, deadline)
    assert Timed.compiled == expected
    assert found.seconds == 0.001 * expected[-1]


def test_one_rollout_has_to_do_where_four_take_too_long(planner, monkeypatch):
    class Slow(Timed):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            self.seconds *= 100.0

    monkeypatch.setattr(population, "_compiled", Slow)
    Timed.compiled.clear()
    compile_population(planner, 0, Wanted(0.5), Stopped(), 100.0)
    assert Timed.compiled == [4, 1]


def test_where_errors_are_avoided_so_many_rollouts_that_rare_ones_are_seen(planner, monkeypatch):
    monkeypatch.setattr(population, "_compiled", Timed)
    monkeypatch.setattr(planner, "lose_on_error", True)
    Timed.compiled.clear()
    # 100 populations of 128 rollouts take 12.8 seconds, of the 45 that the search has
    compile_population(planner, 0, Wanted(0.5), Stopped(), 100.0)
    assert Timed.compiled == [128]
    Timed.compiled.clear()
    # and not the 8 that are left here, for which another program is no longer compiled
    compile_population(planner, 0, Wanted(0.5), Stopped(), 26.0)
    assert Timed.compiled == [128]
    Timed.compiled.clear()
    compile_population(planner, 0, Wanted(0.5), Stopped(), 31.0)
    assert Timed.compiled == [128, 32]
    Timed.compiled.clear()
    # nor are 128 compiled where the judge's rollouts say that these take too long
    compile_population(planner, 0, Wanted(0.5, rollout_seconds=1.0), Stopped(), 100.0)
    assert Timed.compiled == [32]


def test_where_chance_plays_no_part_one_rollout_is_enough(planner, monkeypatch):
    monkeypatch.setattr(population, "_compiled", Timed)
    Timed.compiled.clear()
    compile_population(planner, 0, Wanted(0.5, deterministic=True), Stopped(), 100.0)
    assert Timed.compiled == [1]


def test_where_a_program_would_come_too_late_the_judge_s_plays_policies_one_by_one(
    planner, monkeypatch
):
    monkeypatch.setattr(population, "_compiled", refuse)
    # it takes 10 of the 12 seconds that are left
    wanted = Wanted(0.5, program_seconds=10.0, judged=4)
    found = compile_population(planner, 0, wanted, Stopped(), 12.0)
    weights = weights_of(planner.feedback_plan.noop(0), ["shared"])
    vectors = np.random.default_rng(0).normal(size=(found.population, weights.start.size))
    assert found.compile_seconds == 10.0
    returns = found(weights, 3, vectors)
    assert len(set(returns)) > 1
    np.testing.assert_array_equal(found(weights, 3, vectors), returns)
    assert np.any(found(weights, 4, vectors) != returns)
    # what returns most there does so in other rollouts
    np.testing.assert_array_equal(found.best(weights, list(vectors)), vectors[np.argmax(returns)])


def test_one_by_one_they_end_with_the_race(planner, monkeypatch):
    clock = Stopped()

    def play(key, params):
        clock.now += 1.0
        return np.full((1, 2), clock.now)

    monkeypatch.setattr(one_by_one, "exact_returns", lambda planner, rollouts: play)
    program = one_by_one.OneByOne(planner, 2, 10.0, clock, deadline=3.5)
    found = program(None, {"a": np.zeros((8, 1))})
    assert found[:, 0].tolist() == [1.0, 2.0, 3.0, *[-np.inf] * 5]
    assert program.seconds == 8.0
    # the first of a population is played in any case
    assert program(None, {"a": np.zeros((8, 1))})[:2, 0].tolist() == [4.0, -np.inf]


class Losing:
    """Rollouts of which each candidate loses the first so many-th one, of all that were made."""

    def __init__(self, firsts, rollouts=4, seconds=0.0):
        self._firsts, self._rollouts, self.seconds = np.array(firsts), rollouts, seconds
        self.calls, self.keys = 0, []

    def __call__(self, key, params):
        numbers = self._rollouts * self.calls + np.arange(self._rollouts)
        self.calls += 1
        self.keys.append(tuple(np.asarray(key).tolist()))
        return np.where(numbers == self._firsts[:, np.newaxis], LOST, 1.0)


@pytest.mark.parametrize(
    # which rollout each candidate loses first, how long four of each take, whether they may be lost
    ("firsts", "seconds", "avoids", "calls"),
    [
        # as long as fewer than half of them have lost one
        ([0, 1, 900, 950], 0.0, True, 1),
        ([0, 9, 900, 950], 0.0, True, 3),
        # as many as there may be
        ([0, 5000, 5000, 5000], 0.0, True, 1024),
        # or in half a second
        ([0, 5000, 5000, 5000], 0.1, True, 5),
        ([0, 5000, 5000, 5000], 0.0, False, 1),
    ],
)
def test_candidates_that_have_lost_nothing_have_more_rollouts(
    planner, firsts, seconds, avoids, calls
):
    program = Losing(firsts, seconds=seconds)
    found = PopulationReturns(program, Size(4, 4, None), 0, avoids)
    weights = weights_of(planner.feedback_plan.noop(0), ["shared"])
    returns = found(weights, 0, np.zeros((4, weights.start.size)))
    assert program.calls == len(set(program.keys)) == calls
    lost = np.array(firsts) < 4 * calls
    np.testing.assert_allclose(returns, np.where(lost, (LOST - 1.0) / (4 * calls) + 1.0, 1.0))


def test_the_best_one_is_told_in_as_many_rollouts_where_errors_are_avoided(planner):
    program = Losing([100, 3000, 4096, 90], rollouts=128)
    found = PopulationReturns(program, Size(4, 128, None), 0, avoids=True)
    weights = weights_of(planner.feedback_plan.noop(0), ["shared"])
    vectors = list(np.arange(4.0)[:, np.newaxis] + np.zeros(weights.start.size))
    np.testing.assert_array_equal(found.best(weights, vectors), vectors[2])
    assert program.calls == 32
