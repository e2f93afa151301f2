"""How the arm that learns a value goes on, and what it gives up, by a clock that does not wait."""

import json
import math

import numpy as np
import pytest
from helpers.learners import compiled_arm, taken, ticking_arena
from helpers.problems import assert_same_bits

from mdpo_rddl.auto.common.span import Span
from mdpo_rddl.auto.common.state import State
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
    return Shown(*2 * [np.full(2, mean, np.float32)], np.array(is_finite))


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


def through_json(state: State) -> State:
    return State(dict(state.tensors), json.loads(json.dumps(dict(state.values))))


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


def test_another_process_goes_on_with_the_learner_and_its_span(arena, make):
    arm = make()
    assert arm.state() is None
    arm.work(arena.clock.now + 5.0)
    left = through_json(arm.state())
    assert set(left.values) == {"began", "ends", "parents"}
    assert set(left.tensors) == {f"learner/{number}" for number in range(len(left.tensors))}
    later = make()
    later.restore(left)
    assert later.state() is left  # before its program is compiled
    later._compile()
    restored = later.state()
    assert restored is not left
    assert_same_bits(restored.tensors, left.tensors)
    assert restored.values == left.values
    later.take_over(arm.log, False)
    later.work(arena.clock.now + 5.0)
    assert later.log.iterations > arm.log.iterations
    # it has gone on with the span, and begun none
    assert later.state().values == left.values


MISFITS = [
    lambda tensors, values: tensors.update({"learner/0": np.zeros(99)}),
    lambda tensors, values: tensors.update(
        {"learner/0": np.full_like(tensors["learner/0"], np.nan)}
    ),
    lambda tensors, values: tensors.pop("learner/3"),
    lambda tensors, values: values.update(ends=math.inf),
    lambda tensors, values: values.pop("began"),
    lambda tensors, values: values.update(parents=None),
]


@pytest.mark.parametrize("change", MISFITS)
def test_a_state_that_does_not_fit_is_left_out(arena, make, change, caplog):
    caplog.set_level("INFO")
    arm = make()
    arm.work(arena.clock.now + 1.0)
    left = arm.state()
    tensors, values = dict(left.tensors), dict(left.values)
    change(tensors, values)
    later = make()
    later._try(later.restore, State(tensors, values))
    later._compile()
    assert f"{later.name}: its state is left out: " in caplog.text
    assert later._learner is None
    later.work(arena.clock.now + 1.0)
    assert later.log.iterations > 0


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
