"""The arm that learns from exact rollouts, in slices by a clock that does not wait."""

import math
from dataclasses import replace

import jax
import numpy as np
import pytest
from helpers.learners import BEST, compiled_arm, taken, ticking_arena
from helpers.learners import known as known_to_judge
from helpers.problems import assert_same_bits

from mdpo_rddl.auto.arms.learning import Span
from mdpo_rddl.auto.arms.policy_gradient import PolicyGradientArm
from mdpo_rddl.planner.policy_gradient.ppo import Pace, Shown

# a program of its own is compiled for them all
pytestmark = pytest.mark.long


@pytest.fixture
def arena():
    return ticking_arena()


@pytest.fixture
def make(arena):
    return lambda until=120.0: compiled_arm(PolicyGradientArm, arena, until)


def known(arena):
    """The best policy, with a return that nobody reaches."""
    return replace(known_to_judge(arena), mean=1e9, error=0.0)


def offered(arm, judge):
    """The one candidate of a slice, as the judge sees it."""
    (candidate,) = taken(arm, judge)
    return candidate


def test_the_best_action_is_learnt_and_progress_rises(arena, make):
    arm = make()
    assert arm.progress == -math.inf
    arm.work(arena.clock.now + 30.0)
    early, _ = arm.progress, offered(arm, arena.judge)
    arm.work(arena.clock.now + 80.0)
    found = offered(arm, arena.judge)
    assert found.known_mean == pytest.approx(BEST, rel=0.05)
    assert arm.reached == found.mean
    assert arm.progress > early
    assert (found.arm, found.label, found.parents) == ("ppo", "ppo, phase 1", ())
    assert arm.log.iterations >= 10


def test_a_later_phase_goes_on_from_the_best_policy_so_far(arena, make):
    arm = make(until=20.0)
    assert arm.descends
    arm.work(arena.clock.now + 10.0)
    offered(arm, arena.judge)
    arena.judge.record(known(arena))
    # the first phase has a quarter of the time at least
    arena.clock.now = 80.0
    arm.work(81.0)
    found = offered(arm, arena.judge)
    assert (found.label, found.parents) == ("ppo, phase 2", ("other",))
    # its odds were scaled down, so that other arms are tried
    began = found.params["own"]["pull"]["bias"]
    assert np.argmax(began) == 2
    assert 0.0 < began[2] < 3.0
    assert found.known_mean == pytest.approx(BEST, rel=0.05)


def test_a_phase_ends_once_its_law_explores_no_more(arena, make, monkeypatch):
    arm, shown = make(), [Shown(np.float32(1.0), np.float32(e), True) for e in (0.5, 0.4, 0.001)]
    with monkeypatch.context() as patched:
        patched.setattr(arm, "_iterated", lambda learner, *_: (learner, shown.pop(0)))
        arm.work(arena.clock.now + 100.0)
    assert (arm.log.iterations, shown) == (3, [])
    assert offered(arm, arena.judge).label == "ppo, phase 1"
    arm.work(arena.clock.now + 1.0)
    assert offered(arm, arena.judge).label == "ppo, phase 2"


def test_a_later_phase_that_finds_nothing_gives_way_to_one_of_smaller_steps(arena, make):
    arm = make(until=0.0)
    arena.judge.record(known(arena))
    arm.work(arena.clock.now + 1.0)
    offered(arm, arena.judge)
    arena.clock.now, factors = 200.0, []
    for _ in range(3):
        arm.work(arena.clock.now + 1.0)
        offered(arm, arena.judge)
        factors.append(arm._factor)
    assert factors == pytest.approx([0.3, 0.15, 0.075])


def test_where_nothing_was_learnt_the_policy_of_before_is_offered(arena, make, monkeypatch):
    arm, broken = make(), Shown(np.float32(np.nan), np.float32(0.0), True)
    monkeypatch.setattr(arm, "_iterated", lambda learner, *_: (learner, broken))
    arm.work(arena.clock.now + 100.0)
    (candidate,) = arm.take_candidates()
    assert_same_bits(candidate.params, jax.tree.map(np.asarray, arena.noop))


def test_a_policy_with_a_plan_is_not_gone_on_from(arena, make):
    arm = make(until=0.0)
    arm.work(arena.clock.now + 1.0)
    offered(arm, arena.judge)
    planned = known(arena)
    plan = {"pull": np.ones_like(arena.noop["plan"]["pull"])}
    arena.judge.record(replace(planned, params={**planned.params, "plan": plan}))
    arena.clock.now = 200.0
    arm.work(201.0)
    assert offered(arm, arena.judge).parents == ()


def test_step_and_bonus_fall_within_a_phase(make):
    arm = make()
    arm._span, arm._factor = Span(10.0, 20.0), 0.5
    paces = [arm._pace(now) for now in (10.0, 15.0, 18.0, 20.0, 90.0)]
    assert paces[0] == Pace(0.5 * 5e-3, 0.5 * 0.02)
    assert paces[1].step == pytest.approx(0.5 * paces[0].step)
    assert paces[2].entropy == 0.0
    assert paces[3].step == paces[4].step == pytest.approx(0.02 * paces[0].step)
