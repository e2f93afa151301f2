"""Constants and random rules."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.clocks import Stopped

from mdpo_rddl.auto.arms import simple
from mdpo_rddl.auto.arms.simple import RANDOM_RULE, Rules, SimpleArm
from mdpo_rddl.auto.common.candidate import NOOP

POPULATION = 32


class Rollouts:
    """A population returns each rule's first weight, after 0.01 seconds."""

    population = POPULATION

    def __init__(self, clock: Stopped) -> None:
        self.played: list[np.ndarray] = []
        self._clock = clock

    def __call__(self, rules: Any, iteration: int, vectors: np.ndarray) -> np.ndarray:
        self._clock.now += 0.01
        self.played.append(vectors)
        return vectors[:, 0]

    def best(self, rules: Any, vectors: list[np.ndarray]) -> np.ndarray:
        return max(vectors, key=lambda vector: vector[0])


class Arena:
    """Compiling takes 50 of its 60 seconds."""

    noop = constant = plan = None
    noop_return = SimpleNamespace(mean=1.0)
    seed, deadline = 3, 60.0

    def __init__(self) -> None:
        self.clock = Stopped()
        self.population = Rollouts(self.clock)

    def compile_population(self) -> None:
        if not self.population.played:
            self.clock.now += 50.0

    def candidate(self, arm: str, label: str, params: Any) -> Any:
        return SimpleNamespace(arm=arm, label=label, params=params)


@pytest.fixture
def arena(monkeypatch):
    rules = SimpleNamespace(start=np.zeros(4), to_params=lambda vector: vector)
    monkeypatch.setattr(simple, "simple_weights", lambda params, plan: rules)
    return Arena()


def test_compiling_takes_nothing_from_the_time_of_the_rules(arena):
    arm = SimpleArm(arena)
    arm.work(0.0)
    assert next(one.label for one in arm.take_candidates()) == NOOP
    arm.rules = Rules.FEW
    arm.work(3.0)
    (found,) = arm.take_candidates()
    assert found.label == RANDOM_RULE
    assert len(arena.population.played) * POPULATION == 2048
    assert found.params[0] == np.concatenate(arena.population.played)[:, 0].max()


def test_another_part_draws_many_more_and_ends_in_time(arena):
    arm = SimpleArm(arena)
    arm.rules = Rules.FEW
    arm.work(3.0)
    arm.take_candidates()
    before = len(arena.population.played)
    arm.rules = Rules.MANY
    arm.work(arena.clock.now + 2.0)
    (found,) = arm.take_candidates()
    drawn = np.concatenate(arena.population.played[before:])
    assert len(drawn) == pytest.approx(200 * POPULATION, abs=2 * POPULATION)
    assert found.params[0] == drawn[:, 0].max()


def test_it_tells_how_many_of_its_rules_return_more_than_the_noop(arena):
    arm = SimpleArm(arena)
    assert arm.paid_share is None
    arm.rules = Rules.FEW
    arm.work(3.0)
    returns = np.concatenate(arena.population.played)[:, 0]
    assert 0.0 < arm.paid_share == (returns > 1.005).mean() < 0.2


def drawn(arena, *parts: Rules) -> np.ndarray:
    """The rules of the last part, drawn by one arm."""
    arm, before = SimpleArm(arena), 0
    for part in parts:
        before = len(arena.population.played)
        arm.rules = part
        arm.work(arena.clock.now + 1.0)
    return np.concatenate(arena.population.played[before:])


def test_a_race_that_goes_on_draws_the_rules_that_its_part_would_have_drawn(arena):
    few = drawn(arena, Rules.FEW)
    many = drawn(arena, Rules.FEW, Rules.MANY)
    again = drawn(arena, Rules.MANY)
    np.testing.assert_array_equal(again[:2048], many[:2048])
    assert len(again) > len(few) == 2048
    assert not np.isin(few[few != 0.0], again).any()
