"""The arm that climbs with many straight-line plans."""

import time
from dataclasses import replace

import numpy as np
import pytest
from helpers.lakes import preset
from helpers.learners import taken
from helpers.toys import toy

from mdpo_rddl.auto import RaceOptions
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.arms import shooting
from mdpo_rddl.auto.arms.shooting import ShootingArm
from mdpo_rddl.auto.race import race
from mdpo_rddl.errors import Cancelled

FOREVER = 300.0
# see tests/planner/test_shooting.py
OPTIMUM = -(2.25 + 0.25 + 0.25)


@pytest.fixture(scope="module")
def compiled():
    problem = toy("boats", TERMINATION="false")
    return race._arena(problem, preset(FOREVER), 0, time.monotonic(), RaceOptions())


@pytest.fixture
def arena(compiled):
    """One whose judge knows the no-op only."""
    judge = Judge(8, 0, time.monotonic, compiled.began)
    judge._players = compiled.judge._players
    arena = replace(compiled, judge=judge, most_iterations=2000)
    arena.__dict__["straight_line"] = compiled.straight_line
    judge.record(arena.candidate("", "no-op", arena.noop))
    return arena


def begun(arm: ShootingArm) -> ShootingArm:
    arm.begin(time.monotonic() + FOREVER)
    assert not arm.is_pending
    return arm


def test_chance_that_nobody_feels_plays_no_part(compiled):
    assert compiled.probe.deterministic
    assert not compiled.probe.certain


def test_plans_climb_in_slices(arena):
    arm, found, pulses = begun(ShootingArm(arena)), [], []
    arm._arena = replace(arena, pulse=lambda: pulses.append(arm.log.iterations))
    arm._arena.__dict__["straight_line"] = arena.straight_line
    assert 0 < arm.log.iterations < 100
    while not arm.is_exhausted:
        arm.work(time.monotonic())
        arm.await_program(time.monotonic() + FOREVER)
        found += taken(arm, arena.judge)
    assert arm.log.iterations == pytest.approx(2000, abs=50)
    assert len(pulses) > 10
    assert pulses == sorted(pulses)
    best = found[-1]
    assert arm.reached == best.mean == pytest.approx(OPTIMUM, abs=1e-3)
    assert best.planner is arena.straight_line.built.planner
    assert best.label.startswith("shooting, iteration ")
    # the judge has compiled nothing to play it
    assert all(planner is not best.planner for planner, _ in arena.judge._players)
    # none is handed in twice
    means = [candidate.mean for candidate in found]
    assert means == sorted(set(means))


@pytest.mark.parametrize("test_seconds", [1e-6, 10.0 * FOREVER])
def test_plans_are_crossed_where_the_time_reaches(arena, monkeypatch, test_seconds):
    arm, asked = begun(ShootingArm(arena)), []
    monkeypatch.setattr(
        shooting, "crossed", lambda plans, *_: (asked.append(1), (plans["pull"][0], -np.inf))[1]
    )
    number, arm._test_seconds = arm._number, test_seconds * arm._begun.steps
    arm._end_phase()
    assert len(asked) == (test_seconds < 1.0)
    assert arm._number == number + 1


def test_a_phase_begins_around_the_best_plan_of_the_last(arena):
    arm = begun(ShootingArm(arena))
    arm._advance(5)
    climbed = arm._climb
    arm._end_phase()
    assert (arm._number, arm._done) == (1, 0)
    assert arm._estimate >= np.max(climbed.returns)
    for name, plan in arm._best.items():
        np.testing.assert_array_equal(arm._climb.plans[name][0], plan)
    assert np.max(arm._climb.returns) == pytest.approx(arm._estimate)
    spread = [np.max(np.abs(plan - arm._best["pull"])) for plan in arm._climb.plans["pull"]]
    assert 0.0 == spread[0] < spread[-1] < 0.2


def test_phases_become_longer_with_smaller_steps_and_begin_again():
    phases = [shooting._Phase.numbered(number) for number in range(11)]
    lengths, paces = [p.iterations for p in phases[:10]], [p.pace for p in phases[:10]]
    assert lengths == sorted(set(lengths))
    assert paces == sorted(set(paces), reverse=True)
    assert phases[10] == phases[0]
    assert phases[0].spread > phases[1].spread == phases[9].spread > 0.0


def test_an_arm_of_a_race_that_goes_on_begins_with_its_policy(arena):
    first = begun(ShootingArm(arena))
    while not arena.judge.best_of_arm("shooting"):
        first.work(time.monotonic() + 0.2)
        first.await_program(time.monotonic() + FOREVER)
        taken(first, arena.judge)
    known = arena.judge.best_of_arm("shooting")
    again = begun(ShootingArm(arena))
    assert again.reached >= known.mean - 1e-4


def test_what_was_found_before_an_interrupt_is_handed_in(arena):
    arm = begun(ShootingArm(arena))
    while not taken(arm, arena.judge):
        arm.work(time.monotonic())
        arm.await_program(time.monotonic() + FOREVER)

    def cancel():
        raise Cancelled

    arm._arena = replace(arena, pulse=cancel)
    arm._arena.__dict__["straight_line"] = arena.straight_line
    with pytest.raises(Cancelled):
        arm.work(time.monotonic() + FOREVER)
    (candidate,) = taken(arm, arena.judge)
    assert candidate.mean == pytest.approx(arm._estimate, rel=1e-5)


def test_many_numbers_leave_room_for_few_plans(arena, monkeypatch):
    monkeypatch.setattr(shooting, "_MOST_NUMBERS", 40)
    arm = begun(ShootingArm(arena))
    # 12 numbers each
    assert len(arm._climb.returns) == 3
    # of more plans than climb side by side
    plans = {
        name: np.asarray(each)[[0, 1, 2, 0, 1, 2, 0]] for name, each in arm._climb.best.items()
    }
    three = arm._shooting.returns(arm._climb.best)
    np.testing.assert_allclose(arm._returns(plans), three[[0, 1, 2, 0, 1, 2, 0]])
