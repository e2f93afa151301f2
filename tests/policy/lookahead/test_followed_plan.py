"""The plan that an episode follows, and that the next one begins with."""

from dataclasses import dataclass

import numpy as np
import pytest
from helpers.clocks import Stopped
from helpers.levers import NONE, lever_policy
from helpers.slow_simulator import SlowSimulator
from helpers.tiny_policy import idle_policy

from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.first_actions import FirstActions
from mdpo_rddl.policy.lookahead.one_step import OneStep
from mdpo_rddl.policy.lookahead.played_plan import PlayedPlan
from mdpo_rddl.policy.lookahead.simulator import NARROW, WIDE
from mdpo_rddl.policy.lookahead.statistics import decision_figures

START = {"pulled": np.zeros(3, bool)}


class Silent(FirstActions):
    """Proposes nothing."""

    def propose(self, gains, random):
        return np.zeros((0, 1, 3), np.float32)


@pytest.fixture
def follows(monkeypatch):
    """A plan that pulls the first arm is followed."""
    plan = np.eye(12, 3, dtype=np.float32) * [1, 0, 0]
    monkeypatch.setattr(PlayedPlan, "followed", lambda *_: plan.copy())


@dataclass
class Uncertain(SlowSimulator):
    """Whatever is pulled gains that on average, within its error, if it is no larger than 1."""

    mean: float = 0.0

    def gains(self, kind, state, step, candidates, seed):
        self.clock.now += self.durations[kind]
        noise = np.tile([-1.0, 1.0], 8)
        return np.repeat(self.mean + noise[np.newaxis], len(candidates) - 1, axis=0)


@pytest.mark.usefixtures("follows")
@pytest.mark.parametrize(
    ("mean", "call", "is_left"), [(0.1, 0.2, True), (-0.1, 0.2, False), (-0.1, 0.3, True)]
)
def test_a_plan_goes_on_as_long_as_it_gains_or_nothing_else_is_known(mean, call, is_left):
    clock, method = Stopped(), Silent()
    simulator = Uncertain(lever_policy(NONE), clock, {WIDE: 0.0, NARROW: call}, mean=mean)
    if call > 0.25:
        simulator.durations[WIDE] = call
    method.applies(simulator.components)
    thinker = LookaheadPolicy(simulator, method, 0.25, seed=0, clock=clock)
    action = thinker(0, START)
    assert bool(np.asarray(action["pull"])[0]) == is_left
    (decision,) = thinker.decisions
    assert decision.left_base == is_left
    # a plan goes on without a gain beyond its error; without a test none is expected
    gain = mean if mean > 0.0 else 0.0
    assert decision.gain == pytest.approx(gain)
    assert decision.gain <= decision.error


@dataclass
class Overrunning(SlowSimulator):
    """Calls of a search take far longer than is expected."""

    def gains(self, kind, state, step, candidates, seed):
        found = super().gains(kind, state, step, candidates, seed)
        self.clock.now += 1.0
        return found


@pytest.mark.usefixtures("follows")
def test_a_plan_goes_on_where_its_test_comes_too_late():
    clock, method = Stopped(), FirstActions()
    simulator = Overrunning(lever_policy(NONE), clock, {WIDE: 0.001, NARROW: 0.001})
    method.applies(simulator.components)
    thinker = LookaheadPolicy(simulator, method, 0.25, seed=0, clock=clock)
    action = thinker(0, START)
    np.testing.assert_array_equal(action["pull"], [True, False, False])
    (decision,) = thinker.decisions
    assert (decision.calls, decision.left_base) == (1, True)
    assert (decision.gain, decision.error) == (0.0, 0.0)


class Paying(SlowSimulator):
    """Nothing is random; to pull the first arm pays 10 at the third step and costs 1 at others."""

    is_legal = True
    pays = ((2, 10.0),)

    def legal(self, state, actions):
        return np.full(len(actions), self.is_legal)

    def gains(self, kind, state, step, candidates, seed):
        self.clock.now += self.durations[kind]
        pulled = candidates[:, :, 0] > 0.0
        steps = step + np.arange(candidates.shape[1])
        returns = pulled @ np.array([dict(self.pays).get(step, -1.0) for step in steps])
        return (returns[1:] - returns[0])[:, np.newaxis]


def paying():
    clock = Stopped()
    durations = {WIDE: 0.001, NARROW: 0.001}
    simulator = Paying(lever_policy(NONE), clock, durations, may_draw=False, is_random=False)
    method = FirstActions()
    method.applies(simulator.components)
    return simulator, LookaheadPolicy(simulator, method, 0.25, seed=0, clock=clock)


def pulled(thinker, steps=4):
    return [bool(thinker(step, START)["pull"][0]) for step in range(steps)]


def test_what_an_episode_has_found_is_played_in_the_next():
    simulator, thinker = paying()
    assert pulled(thinker) == [False, False, True, False]
    # whatever else is pulled now has the plan after it, and so has the policy's own action
    for _ in range(2):
        thinker.decisions.clear()
        assert pulled(thinker) == [False, False, True, False]
        gains = [decision.gain for decision in thinker.decisions]
        assert gains == pytest.approx([10.0, 0.0, 0.0, 0.0])
    # of what was not played the plan is kept, and without a search there is nothing else
    assert pulled(thinker, 2) == [False, False]
    simulator.durations[WIDE] = 1.0
    assert pulled(thinker) == [False, False, True, False]
    thinker.forget()
    assert pulled(thinker) == [False] * 4


def test_decisions_expect_what_they_add_to_the_plan_that_is_followed():
    simulator, thinker = paying()
    assert pulled(thinker) == [False, False, True, False]
    assert [decision.gain for decision in thinker.decisions] == [0.0, 0.0, 10.0, 0.0]
    thinker.decisions.clear()
    # the plan is known from the start on, and mended at the second step
    simulator.pays = ((1, 3.0), (2, 10.0))
    assert pulled(thinker) == [False, True, True, False]
    assert [decision.gain for decision in thinker.decisions] == [10.0, 3.0, 0.0, 0.0]
    figures = decision_figures(thinker.decisions, budget=0.25, episodes=1)
    assert figures["expected_gain"] == 13.0


def test_an_episode_expects_of_a_plan_what_the_last_one_did_without_time_at_the_first_decision():
    simulator, thinker = paying()
    pulled(thinker)
    thinker.decisions.clear()
    simulator.durations[WIDE] = 1.0
    thinker(0, START)
    simulator.durations[WIDE] = 0.001
    for step in (1, 2, 3):
        thinker(step, START)
    assert [decision.gain for decision in thinker.decisions] == [10.0, 0.0, 0.0, 0.0]


def test_an_episode_expects_what_is_left_of_a_plan_where_an_action_is_replaced():
    _, thinker = paying()
    pulled(thinker)
    thinker.decisions.clear()
    for step in range(4):
        action = thinker(step, START)
        if step == 0:
            thinker.was_played({"pull": action["pull"] ^ [False, True, False]})
    assert [decision.gain for decision in thinker.decisions] == [0.0, 10.0, 0.0, 0.0]
    thinker.decisions.clear()
    for step in range(4):
        action = thinker(step, START)
        if step == 2:
            thinker.was_played({"pull": action["pull"] ^ [True, False, False]})
    assert [decision.gain for decision in thinker.decisions] == [10.0, 0.0, -10.0, 0.0]


@pytest.mark.parametrize("steps", [(0, 1, 1, 2), (0, 2), (2, 2), (0, 1, 2, 3, 3)])
def test_a_plan_is_followed_at_its_own_steps(steps):
    simulator, thinker = paying()
    pulled(thinker)
    simulator.durations[WIDE] = 1.0
    # the second time it is known all the same
    for _ in range(2):
        assert [bool(thinker(step, START)["pull"][0]) for step in steps] == [
            step == 2 for step in steps
        ]


class Noting(FirstActions):
    """Notes what it is told of episodes."""

    def __init__(self):
        super().__init__()
        self.told = []

    def reset(self):
        self.told.append("reset")

    def resume(self, changes):
        self.told.append(changes[:4, 0].tolist())


def test_a_method_is_told_which_episode_begins():
    simulator, _ = paying()
    method = Noting()
    method.applies(simulator.components)
    thinker = LookaheadPolicy(simulator, method, 0.25, seed=0, clock=simulator.clock)
    pulled(thinker)
    pulled(thinker)
    # what is listed counts from 1
    assert method.told == [[0.0] * 4, [0.0, 0.0, 2.0, 0.0]]
    thinker.forget()
    simulator.may_draw = True
    pulled(thinker)
    assert method.told[2:] == ["reset", "reset"]


def test_by_chance_a_step_that_is_not_the_next_one_is_of_an_unknown_episode():
    simulator, _ = paying()
    simulator.may_draw, method = True, Noting()
    method.applies(simulator.components)
    thinker = LookaheadPolicy(simulator, method, 0.25, seed=0, clock=simulator.clock)
    for step in (0, 1, 1, 3):
        thinker(step, START)
    assert method.told == ["reset"] * 3


def test_the_rest_of_a_plan_goes_on_where_its_next_action_is_illegal():
    simulator, thinker = paying()
    for step in range(4):
        plan = np.zeros((12, 3), np.float32)
        plan[0, 0] = step in (0, 2)
        thinker._plan.shift(plan, np.zeros(3, np.float32))
    simulator.is_legal = False
    assert not thinker(0, START)["pull"][0]
    assert thinker.decisions[-1].gain == pytest.approx(10.0)


def test_an_action_that_was_replaced_is_not_played_in_the_next_episode():
    simulator, thinker = paying()
    for step in range(4):
        action = thinker(step, START)
        if step == 2:
            thinker.was_played({"pull": np.zeros(3, bool)})
            assert action["pull"][0]
            assert thinker.decisions[-1].replaced
    simulator.durations[WIDE] = 1.0
    assert pulled(thinker) == [False] * 4


class Pushing(OneStep):
    """Proposes one push of each unit."""

    name = "pushing"
    rounds = 1

    def begin(self, situation):
        pass

    def propose(self, gains, random):
        return np.array([[[0.4, -0.2]]], np.float32)


@dataclass
class Gaining(SlowSimulator):
    """Whatever is not the policy's own gains 1."""

    def gains(self, kind, state, step, candidates, seed):
        return np.ones((len(candidates) - 1, 1))


@pytest.mark.parametrize(("share", "is_replaced"), [(1e-6, False), (1e-5, False), (1e-3, True)])
def test_what_a_referee_rounds_is_not_replaced(share, is_replaced):
    policy, clock = idle_policy(), Stopped()
    simulator = Gaining(policy, clock, {WIDE: 0.001, NARROW: 0.001}, is_random=False)
    thinker = LookaheadPolicy(simulator, Pushing(), 0.25, seed=0, clock=clock)
    (name, push), *_ = thinker(0, {"x": np.zeros(2)}).items()
    np.testing.assert_allclose(push, [0.4, -0.2], rtol=1e-6)
    thinker.was_played({name: (1.0 - share) * push})
    (decision,) = thinker.decisions
    assert (decision.replaced, decision.left_base) == (is_replaced, not is_replaced)
    assert decision.gain == (0.0 if is_replaced else 1.0)


@pytest.mark.parametrize("may_draw", [False, True])
def test_an_episode_begins_with_a_plan_where_nothing_is_drawn(may_draw):
    simulator, thinker = paying()
    simulator.may_draw = may_draw
    pulled(thinker)
    simulator.durations[WIDE] = 1.0
    assert pulled(thinker)[2] == (not may_draw)


def test_several_observations_leave_nothing_for_an_episode():
    simulator, thinker = paying()
    thinker.batch(2, {"pulled": np.zeros((2, 3), bool)})
    assert thinker.decisions[-1].left_base
    simulator.durations[WIDE] = 1.0
    assert pulled(thinker) == [False] * 4
