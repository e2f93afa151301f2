"""Learning a value, and plans, where the reward comes only once many conditions hold."""

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


def test_goals_are_missed_until_a_policy_beats_the_noop(arena):
    assert arena.misses_goals
    assert not replace(arena, counts_goals=False).misses_goals
    found = replace(arena.candidate("other", "known", arena.noop), mean=1.0, error=0.0)
    arena.judge.record(found)
    assert not arena.misses_goals


@pytest.mark.parametrize("counts", [False, True])
def test_plans_go_by_goals_counted(arena, counts):
    plans = arena.plans
    plans.counts_goals = lambda: counts
    visits = plans._make()
    # the first lock is turned at each step, and open after about one
    plan = np.zeros_like(plans.plan_of(arena.noop))
    plan[:, 0] = 9.0
    population = {
        **plans._repeated(arena.noop),
        "plan": plans._layout(arena.noop).tree(
            np.broadcast_to(plan, (plans._population, *plan.shape))
        ),
    }
    found = visits(plans._key, population)
    returns, counted = (float(np.mean(each)) for each in (found.returns, found.counted))
    assert returns == pytest.approx(-12.0)
    assert (counted > returns + 10.0) == counts
    assert (counted == returns) != counts
