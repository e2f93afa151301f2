"""The arm that learns from exact rollouts, in slices by a clock that does not wait."""

import json
import math
import time
from dataclasses import replace

import jax
import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.lakes import preset
from helpers.problems import assert_same_bits
from helpers.toys import toy

from mdpo_rddl.auto import RaceOptions, race
from mdpo_rddl.auto.arms.policy_gradient import PolicyGradientArm, _Phase
from mdpo_rddl.auto.candidate import Candidate
from mdpo_rddl.auto.judge import Judge
from mdpo_rddl.auto.state import State
from mdpo_rddl.errors import Cancelled
from mdpo_rddl.planner.policy_gradient.ppo import Pace, Shown

# a program of its own is compiled for them all
pytestmark = pytest.mark.long
SECONDS = 300.0
# 3 for the best of three arms, of which one may be pulled, at each of 4 steps
BEST = 3.0 * 0.75 * 4


@pytest.fixture(scope="module")
def compiled():
    words = {"LIKELIHOOD": "0.75", "DISCOUNT": "1.0", "TERMINATION": "false", "MOST": "1"}
    problem = toy("lever", RULES="forall_{?a : arm} [pull(?a) => true];", **words)
    arena = race._arena(problem, preset(SECONDS), 0, time.monotonic(), RaceOptions())
    arm = PolicyGradientArm(arena, 0.0)
    arm._compile()
    return arena, arm._gradient


@pytest.fixture
def arena(compiled):
    """One whose judge knows the no-op only, and whose clock ticks."""
    clock = Ticking()
    judge = Judge(128, 0, clock, 0.0)
    judge._players = compiled[0].judge._players
    arena = replace(compiled[0], judge=judge, clock=clock, began=0.0, deadline=SECONDS)
    judge.record(arena.candidate("", "no-op", arena.noop))
    return arena


@pytest.fixture
def make(arena, compiled, monkeypatch):
    """An arm whose program is compiled already."""
    monkeypatch.setattr(PolicyGradientArm, "_is_compiled", lambda arm, until: True)

    def one(until: float = 120.0) -> PolicyGradientArm:
        arm = PolicyGradientArm(arena, until)
        arm._gradient = compiled[1]
        return arm

    return one


def known(arena) -> Candidate:
    """The best policy, with large odds, and a return that nobody reaches."""
    bias = np.array([-9.0, -9.0, 9.0], np.float32)
    own = {"pull": {**arena.noop["own"]["pull"], "bias": bias}}
    found = arena.candidate("other", "known", {**arena.noop, "own": own})
    return replace(found, mean=1e9, error=0.0)


def taken(arm: PolicyGradientArm, judge: Judge) -> Candidate:
    """The one candidate of a slice, as the judge sees it."""
    (candidate,) = arm.take_candidates()
    judge.record(candidate)
    found = judge.judged[-1].candidate
    arm.judged(found)
    return found


def test_the_best_action_is_learnt_and_progress_rises(arena, make):
    arm = make()
    assert arm.progress == -math.inf
    arm.work(arena.clock.now + 30.0)
    early, _ = arm.progress, taken(arm, arena.judge)
    arm.work(arena.clock.now + 80.0)
    found = taken(arm, arena.judge)
    assert found.known_mean == pytest.approx(BEST, rel=0.05)
    assert arm.reached == found.mean
    assert arm.progress > early
    assert (found.arm, found.label, found.parents) == ("ppo", "ppo, phase 1", ())
    assert arm.log.iterations >= 10


def test_it_is_the_same_at_each_repetition(arena, make):
    found = []
    for _ in range(2):
        arena.clock.now = 0.0
        arm = make()
        arm.work(10.0)
        found += arm.take_candidates()
    assert_same_bits(found[0].params, found[1].params)
    assert np.any(found[0].params["own"]["pull"]["bias"] != arena.noop["own"]["pull"]["bias"])


def test_a_later_phase_goes_on_from_the_best_policy_so_far(arena, make):
    arm = make(until=20.0)
    assert arm.descends
    arm.work(arena.clock.now + 10.0)
    taken(arm, arena.judge)
    arena.judge.record(known(arena))
    # the first phase has a quarter of the time at least
    arena.clock.now = 80.0
    arm.work(81.0)
    found = taken(arm, arena.judge)
    assert (found.label, found.parents) == ("ppo, phase 2", ("other",))
    # its odds were scaled down, so that other arms are tried
    began = found.params["own"]["pull"]["bias"]
    assert np.argmax(began) == 2
    assert 0.0 < began[2] < 3.0
    assert found.known_mean == pytest.approx(BEST, rel=0.05)


def test_a_phase_ends_once_its_law_explores_no_more(arena, make, monkeypatch):
    arm, shown = make(), [Shown(np.float32(1.0), np.float32(e), True) for e in (0.5, 0.4, 0.001)]
    with monkeypatch.context() as patched:
        patched.setattr(arm._gradient, "iterate", lambda learner, *_: (learner, shown.pop(0)))
        arm.work(arena.clock.now + 100.0)
    assert (arm.log.iterations, shown) == (3, [])
    assert taken(arm, arena.judge).label == "ppo, phase 1"
    arm.work(arena.clock.now + 1.0)
    assert taken(arm, arena.judge).label == "ppo, phase 2"


def test_a_later_phase_that_finds_nothing_gives_way_to_one_of_smaller_steps(arena, make):
    arm = make(until=0.0)
    arena.judge.record(known(arena))
    arm.work(arena.clock.now + 1.0)
    taken(arm, arena.judge)
    arena.clock.now, factors = 200.0, []
    for _ in range(3):
        arm.work(arena.clock.now + 1.0)
        taken(arm, arena.judge)
        factors.append(arm._phase.factor)
    assert factors == pytest.approx([0.3, 0.15, 0.075])


def test_what_was_learnt_before_an_interruption_is_offered(arena, make, monkeypatch):
    arm = make()
    iterate, calls = arm._gradient.iterate, []

    def interrupted(*arguments):
        calls.append(arguments)
        if len(calls) > 3:
            raise Cancelled
        return iterate(*arguments)

    monkeypatch.setattr(arm._gradient, "iterate", interrupted)
    with pytest.raises(Cancelled):
        arm.work(arena.clock.now + 100.0)
    assert arm.log.iterations == 3
    assert len(arm.take_candidates()) == 1


def test_another_process_goes_on_with_the_learner_and_its_phase(arena, make):
    arm = make()
    assert arm.state() is None
    arm.work(arena.clock.now + 5.0)
    left = arm.state()
    left = State(dict(left.tensors), json.loads(json.dumps(dict(left.values))))
    later = make()
    later.restore(left)
    assert later.state() is left  # before its program is compiled
    later._go_on(later._gradient.begin(arena.noop, later._phase_key), left)
    assert_same_bits(later._learner, arm._learner)
    assert later._phase == arm._phase
    later.take_over(arm.log, False)
    done = arm.log.iterations
    later.work(arena.clock.now + 5.0)
    assert later.log.iterations > done
    assert later.take_candidates()[0].label == "ppo, phase 1"


@pytest.mark.parametrize(
    "change",
    [
        lambda tensors, values: tensors.update({"learner/0": np.zeros(99)}),
        lambda tensors, values: tensors.update(
            {"learner/0": np.full_like(tensors["learner/0"], np.nan)}
        ),
        lambda tensors, values: tensors.pop("learner/3"),
        lambda tensors, values: values.update(ends=math.inf),
        lambda tensors, values: values.update(phases=0),
        lambda tensors, values: values.update(factor=-1.0),
    ],
)
def test_a_state_that_does_not_fit_is_left_out(arena, make, change):
    arm = make()
    arm.work(arena.clock.now + 1.0)
    left = arm.state()
    tensors, values = dict(left.tensors), dict(left.values)
    change(tensors, values)
    later = make()
    like = later._gradient.begin(arena.noop, later._phase_key)
    assert not later._try(lambda state: later._go_on(like, state), State(tensors, values))
    assert later.state() is None


def test_returns_that_are_not_finite_end_it(arena, make, monkeypatch):
    for mean, is_finite in ((np.nan, True), (1.0, False)):
        arm, broken = make(), Shown(np.float32(mean), np.float32(0.0), is_finite)
        with monkeypatch.context() as patched:
            patched.setattr(arm._gradient, "iterate", lambda learner, *_, s=broken: (learner, s))
            arm.work(arena.clock.now + 100.0)
        assert arm.is_exhausted
        assert arm.log.details["not_finite"] == 10
        assert "not finite" in arm.log.details["cause"]
        # the policy of before
        assert_same_bits(arm.take_candidates()[0].params, jax.tree.map(np.asarray, arena.noop))


def test_a_policy_with_a_plan_is_not_gone_on_from(arena, make):
    arm = make(until=0.0)
    arm.work(arena.clock.now + 1.0)
    taken(arm, arena.judge)
    planned = known(arena)
    plan = {"pull": np.ones_like(arena.noop["plan"]["pull"])}
    arena.judge.record(replace(planned, params={**planned.params, "plan": plan}))
    arena.clock.now = 200.0
    arm.work(201.0)
    assert taken(arm, arena.judge).parents == ()


def test_an_iteration_that_would_end_late_is_not_begun(arena, make):
    arm = make()
    # the clock ticks at each look, so that an iteration seems to take some of it
    arm.work(arena.clock.now + 3.0)
    assert arm.log.iterations >= 1
    before = arm.log.iterations
    arm._iteration_seconds = 50.0
    arm.work(arena.clock.now + 3.0)
    assert arm.log.iterations == before + 1


def test_step_and_bonus_fall_within_a_phase():
    phase = _Phase(None, 10.0, 20.0, 0.5)
    paces = [phase.pace(now) for now in (10.0, 15.0, 18.0, 20.0, 90.0)]
    assert paces[0] == Pace(0.5 * 5e-3, 0.5 * 0.02)
    assert paces[1].step == pytest.approx(0.5 * paces[0].step)
    assert paces[2].entropy == 0.0
    assert paces[3].step == paces[4].step == pytest.approx(0.02 * paces[0].step)
