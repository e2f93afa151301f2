"""Populations on the exact model: how many rollouts each candidate has."""

from typing import ClassVar

import numpy as np
import pytest
from helpers.clocks import Stopped
from helpers.lakes import preset, write_lake

from mdpo_rddl.auto.fitting import without_scales
from mdpo_rddl.auto.search import one_by_one, population
from mdpo_rddl.auto.search.population import Wanted, compile_population
from mdpo_rddl.auto.search.weights import weights_of
from mdpo_rddl.planner.build import build_planner


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
