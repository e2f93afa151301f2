"""How the arm that learns a value goes on, and what it gives up, by a clock that does not wait."""

import math

import numpy as np
import pytest
from helpers.learners import compiled_arm, taken, ticking_arena
from helpers.problems import assert_same_bits

from mdpo_rddl.auto.common.span import Span
from mdpo_rddl.errors import Cancelled
from mdpo_rddl.planner.policy_iteration.learner import Shown

# programs of their own are compiled
pytestmark = pytest.mark.long


@pytest.fixture
def arena():
    return ticking_arena()


@pytest.fixture
def make(arena):
    return lambda until=120.0: compiled_arm(arena, until)


def shown(mean: float, is_finite: bool = True) -> Shown:
    """What an iteration may have shown."""
    return Shown(np.full(2, mean, np.float32), np.array(is_finite))


def showing(monkeypatch, arm, *each) -> None:
    """Lets an arm learn nothing in its iterations, and see this in turn, the last for ever."""
    left = list(each)

    def iterated(learner, *_, **__):
        return learner, left.pop(0) if len(left) > 1 else left[0]

    monkeypatch.setattr(arm, "_iterated", iterated)


def begun(arm, arena):
    """An arm that has learnt for a while, and been judged."""
    arm.work(arena.clock.now + 30.0)
    taken(arm, arena.judge)
    return arm


def test_it_is_the_same_at_each_repetition(arena, make):
    found = []
    for _ in range(2):
        arena.clock.now = 0.0
        arm = make()
        assert arm.progress == -math.inf
        arm.work(30.0)
        found.append(arm.take_candidates()[0])
    assert_same_bits(found[0].params, found[1].params)


def test_what_was_learnt_before_an_interruption_is_offered(arena, make, monkeypatch):
    arm = begun(make(), arena)
    done, calls, iterated = arm.log.iterations, [], arm._iterated

    def interrupted(*arguments):
        calls.append(arguments)
        if len(calls) == 4:
            raise Cancelled
        return iterated(*arguments)

    monkeypatch.setattr(arm, "_iterated", interrupted)
    with pytest.raises(Cancelled):
        arm.work(arena.clock.now + 100.0)
    assert arm.log.iterations == done + 3
    assert arm.take_candidates()


def test_an_iteration_that_would_end_late_is_not_begun(arena, make, monkeypatch):
    arm = begun(make(), arena)
    iterated, done = arm._iterated, arm.log.iterations

    def slow(*arguments):
        arena.clock.now += 4.0
        return iterated(*arguments)

    monkeypatch.setattr(arm, "_iterated", slow)
    arm._judging_seconds = 0.0  # as if these were the first
    until = arena.clock.now + 30.0
    arm.work(until)
    # with the clock's ticks each takes 7 s, of which 5 are its own, as the rollouts of a policy may
    assert arm.log.iterations == done + 3
    assert until - 10.0 < arena.clock.now <= until + 2.0
    # they take less, and that is known
    assert 0.0 < arm._judging_seconds < 7.0


@pytest.mark.parametrize(("mean", "is_finite"), [(np.nan, True), (1.0, False)])
def test_returns_that_are_not_finite_are_counted_and_end_it(
    arena, make, monkeypatch, mean, is_finite
):
    arm = make()
    showing(monkeypatch, arm, shown(mean, is_finite))
    arm.work(arena.clock.now + 100.0)
    assert arm.is_exhausted
    assert arm.log.details["not_finite"] == 10
    assert "not finite" in arm.log.details["cause"]
    assert arm.progress == -math.inf


def test_only_iterations_in_a_row_end_it(arena, make, monkeypatch):
    arm = begun(make(), arena)
    lost, found = shown(np.nan), shown(2.0)
    showing(monkeypatch, arm, *[lost] * 9, found, *[lost] * 9, found)
    arm.work(arena.clock.now + 100.0)
    assert not arm.is_exhausted
    assert arm.log.details == {"not_finite": 18}
    assert arm.progress == 2.0


def test_a_span_s_share_ends_with_it():
    assert [Span(10.0, 20.0).share(now) for now in (10.0, 15.0, 20.0, 90.0)] == [0.0, 0.5, 1.0, 1.0]
    assert Span(10.0, 10.0).share(10.0) == 0.0
