"""Plans that climb side by side on a model in whose return chance plays no part."""

import numpy as np
import pytest
from helpers.toys import toy

from mdpo_rddl.auto.arena.plain import StraightLine
from mdpo_rddl.planner.shooting import Shooting
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment

UNITS = {"pull": np.full(2, 2.0), "steer": np.array(4.0)}


def shooting_of(termination="false") -> Shooting:
    problem = toy("boats", TERMINATION=termination)
    return Shooting(StraightLine(problem, is_single=True).built.planner, UNITS)


@pytest.fixture(scope="module")
def shooting() -> Shooting:
    return shooting_of()


def plans_of(pull, steer=0.0):
    pull = np.array(pull, np.float32)
    return {"pull": pull, "steer": np.full(pull.shape[:2], steer, np.float32)}


def noops(shooting, count=2):
    return {name: np.stack([plan] * count) for name, plan in shooting.noop().items()}


def test_returns_are_those_of_the_environment(shooting):
    plan = np.random.default_rng(0).uniform(-1.0, 1.0, (1, 4, 2))

    def act(step, state):
        return {"pull": plan[0, step], "steer": 0.5}

    played = evaluate(make_environment(toy("boats", TERMINATION="false")), act, 1, 0)
    returns = shooting.returns(plans_of(plan, 0.5))
    assert returns == pytest.approx(played.returns, rel=1e-5)
    assert np.ptp(shooting.returns(plans_of(np.concatenate([plan, -plan])))) > 0.0


def test_each_plan_climbs_to_the_optimum_at_its_own_rate(shooting):
    begun = shooting.begin(noops(shooting))
    # the no-op: 4 steps of 1.5 and 0.5 away, and of 0.25
    assert begun.returns == pytest.approx([-4 * (2.25 + 0.25 + 0.0625)] * 2)
    climb = shooting.climbed(begun, np.array([0.01, 0.0]), 25)
    assert int(climb.moments.count) == 25 * shooting.steps
    # a boat that rows as fast as it can is half a unit away after one step
    assert climb.returns[0] == pytest.approx(-(2.25 + 0.25 + 0.25), abs=1e-3)
    best = {name: np.asarray(plan)[0] for name, plan in climb.best.items()}
    assert best["pull"][:2, 0] == pytest.approx([1.0, 0.5], abs=0.02)
    assert best["pull"][0, 1] == pytest.approx(-0.5, abs=0.02)
    assert best["steer"] == pytest.approx(np.full(4, 0.25), abs=0.02)
    # without a rate nothing moves
    np.testing.assert_array_equal(climb.best["pull"][1], 0.0)
    assert climb.returns[1] == begun.returns[1]


def test_the_best_iterate_of_each_is_kept(shooting):
    climb = shooting.climbed(shooting.begin(noops(shooting)), np.array([0.01, 0.02]), 25)
    worse = climb._replace(plans=plans_of(np.full((2, 4, 2), -1.0)))
    later = shooting.climbed(worse, np.zeros(2), 1)
    np.testing.assert_array_equal(later.returns, climb.returns)
    np.testing.assert_array_equal(later.best["pull"], climb.best["pull"])
    assert shooting.returns(later.best) == pytest.approx(np.asarray(later.returns))
    assert np.max(shooting.returns(later.plans)) < np.min(later.returns)


def test_plans_climb_with_the_options_that_users_have(monkeypatch):
    # the tests' own flags leave no option for its programs
    monkeypatch.delenv("XLA_FLAGS")
    shooting = shooting_of()
    begun = shooting.begin(noops(shooting))
    assert np.all(shooting.climbed(begun, np.array([0.01, 0.02]), 1).returns > begun.returns)


def test_plans_stay_in_their_box(shooting):
    begun = shooting.begin(plans_of(np.full((2, 4, 2), 9.0)))
    np.testing.assert_array_equal(begun.plans["pull"], 1.0)
    climb = shooting.climbed(begun, np.array([0.3, 0.3]), 1)
    assert np.max(np.abs(climb.plans["pull"])) == 1.0


def test_a_climb_goes_on_where_it_was_left(shooting):
    rates, begun = np.array([0.01, 0.03]), shooting.begin(noops(shooting))
    whole = shooting.climbed(begun, rates, 2)
    halves = shooting.climbed(shooting.climbed(begun, rates, 1), rates, 1)
    for one, two in zip(whole.plans.values(), halves.plans.values(), strict=True):
        np.testing.assert_allclose(one, two, atol=1e-6)


def test_nothing_counts_after_the_end():
    ending = shooting_of("exists_{?b : boat} [x(?b) > 0.9]")
    # the first boat ends the episode after one step; its stay would cost 2.25 in each
    ends, stays = ending.returns(plans_of(np.array([[[1.0, 0.0]] * 4, [[0.0, 0.0]] * 4]), 0.25))
    assert ends == pytest.approx(-(2.25 + 0.25))
    assert stays == pytest.approx(-4 * (2.25 + 0.25))
    climb = ending.climbed(ending.begin(noops(ending)), np.array([0.01, 0.02]), 25)
    assert np.max(climb.returns) == pytest.approx(-(2.25 + 0.25), abs=1e-3)
