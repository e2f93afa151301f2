"""The arm that learns a value, where the reward comes only once many conditions hold."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.learners import compiled_arm, taken, ticking_arena

# a program of its own is compiled for them all
pytestmark = pytest.mark.long

# seven locks that open at nine of ten turns, in twelve steps
GOOD = 20.0


@pytest.fixture
def arena():
    return ticking_arena("locks")


def worked(arm, seconds: float):
    arm.work(arm._arena.clock.now + seconds)
    return taken(arm, arm._arena.judge)


def test_goals_are_counted_until_they_are_reached(arena):
    arm = compiled_arm(arena)
    worked(arm, 10.0)
    assert arm.counts_goals
    # what it learns from, beside what its policies return
    assert arm.progress > 1.0 > arena.judge.incumbent.known_mean
    worked(arm, 150.0)
    assert not arm.counts_goals
    best = arena.judge.incumbent
    assert best.arm == arm.name
    assert best.known_mean > GOOD
    worked(arm, 10.0)
    assert arm.progress == pytest.approx(best.known_mean, rel=0.2)


def test_nothing_is_found_without(arena):
    arm = compiled_arm(arena)
    arm._begin_part()
    arm.counts_goals = False
    assert max(candidate.known_mean for candidate in worked(arm, 150.0)) <= 0.0


def test_goals_are_not_counted_where_a_policy_is_known(arena):
    found = replace(arena.candidate("other", "known", arena.noop), mean=1.0, error=0.0)
    arena.judge.record(found)
    arm = compiled_arm(arena)
    worked(arm, 1.0)
    assert not arm.counts_goals


def test_another_process_goes_on_counting(arena):
    arm, later = compiled_arm(arena), compiled_arm(arena)
    worked(arm, 1.0)
    assert arm.counts_goals
    later.restore(arm.state())
    later._compile()
    assert later.counts_goals
    assert np.all(later._learner.weights == arm._learner.weights)
