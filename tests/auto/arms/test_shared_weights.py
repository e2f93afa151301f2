"""Shared weights: rules are adapted from one start after the other."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.clocks import Stopped

from mdpo_rddl.auto.arms import shared_weights
from mdpo_rddl.auto.arms.shared_weights import SharedWeightsArm
from mdpo_rddl.auto.search.rules import Drawn, Rule
from mdpo_rddl.errors import Cancelled

NEAR, FAR = np.array([0.5, 0.0]), np.array([2.2, 2.2])
_SECONDS = 0.01


def two_hills(vectors: np.ndarray) -> np.ndarray:
    """A hill beside the no-op, and a higher one that no small step leads to."""
    near = -np.sum((vectors - NEAR) ** 2, axis=1)
    return np.maximum(near, 20.0 - 10.0 * np.sum((vectors - FAR) ** 2, axis=1))


class Rollouts:
    """A population takes 0.01 seconds."""

    population, seconds = 16, _SECONDS

    def __init__(self, clock: Stopped) -> None:
        self._clock = clock

    def __call__(self, weights, iteration, vectors):
        self._clock.now += _SECONDS
        return two_hills(np.asarray(vectors))

    def best(self, weights, vectors):
        return vectors[int(np.argmax(two_hills(np.stack(vectors))))]


class Arena:
    noop, plan, seed = np.zeros(2), None, 3

    def __init__(self) -> None:
        self.clock = Stopped()
        self.judge = SimpleNamespace(latest=lambda label: None, best_of_arm=lambda arm: self.best)
        self.best = None
        self.population = Rollouts(self.clock)

    def compile_population(self) -> None:
        pass

    def pulse(self) -> None:
        pass

    def candidate(self, arm, label, params):
        return SimpleNamespace(arm=arm, label=label, params=params)


@pytest.fixture(autouse=True)
def _weights(monkeypatch):
    def weights(params, has_all):
        start = np.asarray(params)
        return SimpleNamespace(start=start, to_params=lambda vector: vector, has_all=has_all)

    monkeypatch.setattr(shared_weights, "simple_weights", lambda params, _: weights(params, False))
    monkeypatch.setattr(shared_weights, "weights_of", lambda params, _: weights(params, True))


@pytest.fixture
def simple_rules_alone(monkeypatch):
    """No random rule that has all weights is near the higher hill."""
    drawn = shared_weights.random_rules

    def random_rules(population, weights, *others):
        if weights.has_all:
            return Drawn([Rule(0.0, NEAR)], 1, 0.0)
        return drawn(population, weights, *others)

    monkeypatch.setattr(shared_weights, "random_rules", random_rules)


def worked(arm: SharedWeightsArm, arena: Arena, seconds: float) -> list:
    """What a slice has offered."""
    arm.work(arena.clock.now + seconds)
    found = arm.take_candidates()
    arena.best = found[-1] if found else arena.best
    return [candidate.params for candidate in found]


def after_a_short_slice() -> tuple[Arena, SharedWeightsArm]:
    arena = Arena()
    arm = SharedWeightsArm(arena, "none")
    (found,) = worked(arm, arena, 1.0)
    np.testing.assert_allclose(found, NEAR, atol=0.05)
    return arena, arm


def test_all_weights_begin_at_a_random_rule_too():
    arena = Arena()
    arm = SharedWeightsArm(arena, "none")
    # too short for a simple rule beside those from the no-op
    (found,) = worked(arm, arena, 1.0)
    np.testing.assert_allclose(found, FAR, atol=0.1)
    assert arm._others == 0


@pytest.fixture
def far_in_second_slice(monkeypatch):
    """Simple rules are far from any hill, and those of all weights near the higher one then.

    It has the first number of the generator of each drawing of the latter.
    """
    drawn: list[float] = []

    def random_rules(population, weights, random, drawing):
        if not weights.has_all:
            return Drawn([Rule(0.0, NEAR - 1e12)], 1, 0.0)
        drawn.append(random.random())
        return Drawn([Rule(0.0, FAR if len(drawn) == 2 else NEAR)], 1, 0.0)

    monkeypatch.setattr(shared_weights, "random_rules", random_rules)
    return drawn


def test_a_later_slice_begins_at_another_random_rule_that_has_all_weights(far_in_second_slice):
    arena = Arena()
    arm = SharedWeightsArm(arena, "none")
    (first,), (second,) = (worked(arm, arena, 4.0) for _ in range(2))
    np.testing.assert_allclose(first, NEAR, atol=0.05)
    np.testing.assert_allclose(second, FAR, atol=0.05)
    assert len(set(far_in_second_slice)) == 2


@pytest.mark.usefixtures("far_in_second_slice")
def test_what_was_known_is_not_offered_again_by_a_later_slice_that_is_stopped(monkeypatch):
    arena = Arena()
    arm = SharedWeightsArm(arena, "none")
    worked(arm, arena, 4.0)

    def pulse():
        if len(arm._every) == 1 and arm._adapting.found is not None:
            raise Cancelled

    monkeypatch.setattr(arena, "pulse", pulse)
    with pytest.raises(Cancelled):
        arm.work(arena.clock.now + 4.0)
    (offered,) = arm.take_candidates()
    np.testing.assert_allclose(offered.params, FAR, atol=0.5)


@pytest.mark.usefixtures("simple_rules_alone")
def test_a_slice_that_is_long_enough_begins_at_other_rules_too():
    arena = Arena()
    (found,) = worked(SharedWeightsArm(arena, "none"), arena, 10.0)
    np.testing.assert_allclose(found, FAR, atol=0.05)
    assert arena.clock.now < 10.0 + 3 * _SECONDS


@pytest.mark.usefixtures("simple_rules_alone")
def test_a_later_slice_finds_what_the_first_one_had_no_time_for():
    arena, arm = after_a_short_slice()
    (found,) = worked(arm, arena, 4.0)
    np.testing.assert_allclose(found, FAR, atol=0.05)
    assert not arm.is_exhausted


@pytest.mark.usefixtures("simple_rules_alone")
def test_nothing_is_offered_if_no_other_rule_is_better():
    arena, arm = after_a_short_slice()
    worked(arm, arena, 4.0)
    assert worked(arm, arena, 4.0) == []
    assert not arm.is_exhausted


@pytest.mark.usefixtures("simple_rules_alone")
def test_it_gives_up_where_a_slice_is_too_short_for_another_rule():
    arena, arm = after_a_short_slice()
    for _ in range(3):
        # the first ones in the rounds are shorter than others
        assert not arm.is_exhausted
        assert worked(arm, arena, 0.5) == []
    assert arm.is_exhausted
    assert arena.clock.now == pytest.approx(1.0, abs=3 * _SECONDS)
