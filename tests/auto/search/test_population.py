"""Populations on the exact model: how many rollouts each candidate has."""

from typing import ClassVar

import pytest
from helpers.clocks import Stopped
from helpers.lakes import preset, write_lake

from mdpo_rddl.auto.fitting import without_scales
from mdpo_rddl.auto.search import population
from mdpo_rddl.auto.search.population import Wanted, compile_population
from mdpo_rddl.planner.build import build_planner


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    lake = write_lake(tmp_path_factory.mktemp("lake"))
    return build_planner(lake, without_scales(preset(1.0))).planner


class Timed:
    """A program takes ten seconds to compile, and a millisecond for each candidate's rollout."""

    compiled: ClassVar[list[int]] = []

    def __init__(self, planner, size, seed, clock, deadline):
        self._clock, self.seconds = clock, 0.001 * size.rollouts
        self.population, self.compile_seconds = size.population, 10.0
        clock.now += self.compile_seconds
        self.compiled.append(size.rollouts)

    def __call__(self, weights, iteration, vectors):
        self._clock.now += self.seconds


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
    monkeypatch.setattr(population, "PopulationReturns", Timed)
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

    monkeypatch.setattr(population, "PopulationReturns", Slow)
    Timed.compiled.clear()
    compile_population(planner, 0, Wanted(0.5), Stopped(), 100.0)
    assert Timed.compiled == [4, 1]


def test_where_chance_plays_no_part_one_rollout_is_enough(planner, monkeypatch):
    monkeypatch.setattr(population, "PopulationReturns", Timed)
    Timed.compiled.clear()
    compile_population(planner, 0, Wanted(0.5, deterministic=True), Stopped(), 100.0)
    assert Timed.compiled == [1]
