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
    assert arm.state().values["others"] == 0


def test_a_later_slice_begins_at_another_random_rule_that_has_all_weights(monkeypatch):
    arena, drawn = Arena(), shared_weights.random_rules
    arm = SharedWeightsArm(arena, "none")

    def random_rules(population, weights, *others):
        rules = drawn(population, weights, *others)
        # simple rules never come near the higher hill, and these only in the second slice
        is_near = weights.has_all and arm.state().values["ended"] == 1
        return Drawn([Rule(0.0, FAR if is_near else NEAR)], rules.populations, 0.0)

    monkeypatch.setattr(shared_weights, "random_rules", random_rules)
    (first,), (second,) = (worked(arm, arena, 4.0) for _ in range(2))
    np.testing.assert_allclose(first, NEAR, atol=0.05)
    np.testing.assert_allclose(second, FAR, atol=0.05)


def test_a_random_rule_is_not_drawn_again_where_another_process_has_begun(monkeypatch):
    arena = Arena()
    arm = SharedWeightsArm(arena, "none")
    states = []

    def pulse():
        if len(arm._every) == 2 and arm._adapting.found is not None:
            states.append(arm.state())
            raise Cancelled

    monkeypatch.setattr(arena, "pulse", pulse)
    with pytest.raises(Cancelled):
        worked(arm, arena, 4.0)
    again = SharedWeightsArm(arena, "none")
    again.restore(states[0])
    monkeypatch.setattr(arena, "pulse", lambda: None)
    monkeypatch.setattr(shared_weights, "random_rules", None)
    (found,) = worked(again, arena, 4.0)
    np.testing.assert_allclose(found, FAR, atol=0.05)


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


@pytest.mark.usefixtures("simple_rules_alone")
def test_another_process_goes_on_behind_the_slices_that_have_ended():
    arena, arm = after_a_short_slice()
    again = SharedWeightsArm(arena, "none")
    again.restore(arm.state())
    one, two = worked(arm, arena, 4.0), worked(again, arena, 4.0)
    np.testing.assert_array_equal(one, two)


@pytest.mark.usefixtures("simple_rules_alone")
@pytest.mark.parametrize("name", ["ended", "others"])
def test_a_state_with_a_count_that_is_none_is_refused(name):
    arena, arm = after_a_short_slice()
    state = arm.state()
    state.values[name] = -1
    with pytest.raises(ValueError, match="-1"):
        SharedWeightsArm(arena, "none").restore(state)
