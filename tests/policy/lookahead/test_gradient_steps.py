"""Gradient steps that go on from decision to decision."""

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.tiny_policy import idle_policy

from mdpo_rddl.planner.climbing import Ascent
from mdpo_rddl.policy.lookahead.base import Climbed, Situation
from mdpo_rddl.policy.lookahead.choice import choose
from mdpo_rddl.policy.lookahead.components import Components
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.gradient_steps import GradientSteps
from mdpo_rddl.policy.lookahead.simulator import Simulator
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment

BASE = np.array([0.5, -0.5], np.float32)
RANDOM = np.random.default_rng(0)
START = {"x": np.zeros(2)}


class Climb:
    """Adds 0.25 to all, and remembers what it was given."""

    def __init__(self):
        self.given = []

    def __call__(self, ascent, rates, share):
        self.given.append(ascent)
        moved = ascent.candidates + 0.25, ascent.first + 1.0, ascent.second + 2.0
        return Climbed(Ascent(*moved, ascent.steps + 10), np.ones((1, 4)))


def begun(climb, method=None):
    if method is None:
        method = GradientSteps(depth=4)
        assert method.applies(Components.of(idle_policy().planner))
    method.begin(Situation(BASE, 10, climb))
    return method


def proposed(method):
    return method.propose([], RANDOM)


def with_base(additions):
    return additions + np.eye(4, 1) * BASE


def test_the_plan_and_the_ascents_end_are_proposed():
    candidates = proposed(begun(Climb()))
    plan, end = with_base(np.zeros((4, 2))), with_base(np.full((4, 2), 0.25))
    np.testing.assert_array_equal(candidates, [plan, end])
    # without time for a step there is the plan alone
    assert len(proposed(begun(lambda *_: None))) == 1


def test_the_ascent_moves_on_with_the_plan():
    climb = Climb()
    method = begun(climb)
    method.shift(proposed(method)[1])
    begun(climb, method)
    again = climb.given[1]
    rest = np.full((4, 2), 0.25)
    rest[3] = 0.0
    np.testing.assert_allclose(again.candidates, [with_base(rest)])
    np.testing.assert_allclose(again.first[0], 4.0 * rest)
    np.testing.assert_allclose(again.second[0], 8.0 * rest)
    assert again.steps == [10]
    np.testing.assert_allclose(proposed(method)[0], with_base(rest))


def test_what_is_planned_after_the_ascent_comes_with_it():
    climb = Climb()
    method = begun(climb)
    plan = np.full((6, 2), 0.5)
    method.shift(np.concatenate([proposed(method)[1], plan[4:]]))
    begun(climb, method)
    given = climb.given[1]
    expected = np.array([[0.25] * 2] * 3 + [[0.5] * 2])
    np.testing.assert_allclose(given.candidates, [with_base(expected)])
    assert not np.any(given.first[0, 3])
    assert np.all(given.first[0, :3] == 1.0)
    # a plan for another episode begins without moments
    method.resume(plan)
    begun(climb, method)
    np.testing.assert_allclose(climb.given[2].candidates, [with_base(plan[:4])])
    assert climb.given[2].steps == [0]


def test_what_is_refused_again_and_again_begins_anew():
    climb, method = Climb(), None
    for _ in range(6):
        method = begun(climb, method)
        method.shift(with_base(np.zeros((4, 2))).astype(np.float32))
    assert [ascent.steps[0] for ascent in climb.given] == [0, 10, 20, 30, 40, 0]
    np.testing.assert_array_equal(proposed(method)[0], with_base(np.zeros((4, 2))))
    method.shift(proposed(method)[1])
    assert np.any(proposed(method)[0] != with_base(np.zeros((4, 2))))
    method.reset()
    np.testing.assert_array_equal(proposed(method)[0], with_base(np.zeros((4, 2))))


@pytest.mark.long
def test_a_policy_that_never_acts_is_improved():
    policy, clock = idle_policy(), Ticking(0.01)
    simulator = Simulator(policy, 4, clock)
    method = GradientSteps(depth=4)
    assert method.applies(simulator.components)
    simulator.prepare(START, 1.0)
    assert simulator.climbers == 1
    simulator.prepare_climbing(START)
    thinker = LookaheadPolicy(simulator, method, 1.0, seed=0, clock=clock)
    played = evaluate(make_environment(policy.problem), thinker, 1, 0)
    # the best is to pay for the start alone
    assert played.mean == pytest.approx(-0.5, abs=0.01)
    assert played.illegal_actions == 0


@pytest.mark.long
def test_where_chance_plays_a_part_they_are_not_tried():
    def tried(spread):
        clock, methods = Ticking(0.001), [GradientSteps(depth=4)]
        return choose(idle_policy(spread), 0.2, 60.0, clock, methods).trials

    assert [trial.method for trial in tried(0.0)] == ["gradient steps"]
    assert tried(1.0) == []
