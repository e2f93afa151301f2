"""A decision: what is played, and how long it takes."""

import functools
from dataclasses import dataclass

import numpy as np
import pytest
from helpers.clocks import Stopped, Ticking
from helpers.levers import NONE, lever_policy
from helpers.slow_simulator import SlowSimulator

from mdpo_rddl.policy.lookahead.coordinate import Coordinate
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.first_actions import FirstActions
from mdpo_rddl.policy.lookahead.halving import Halving
from mdpo_rddl.policy.lookahead.simulator import NARROW, WIDE, Simulator
from mdpo_rddl.policy.lookahead.statistics import decision_figures
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment

SECONDS = 0.5
START = {"pulled": np.zeros(3, bool)}


@functools.cache
def prepared(pulled, **words):
    """Compiled once, with a clock of its own: what a machine can do in time is not tested."""
    simulator = Simulator(lever_policy(pulled, **words), depth=1, clock=Ticking(0.01))
    simulator.prepare(START, SECONDS)
    return simulator


def thinking(simulator, method):
    assert method.applies(simulator.components)
    return LookaheadPolicy(simulator, method, 2 * SECONDS, seed=0, clock=Ticking(0.01))


def play(policy, thinker):
    return evaluate(make_environment(policy.problem), thinker, episodes=1, seed=0)


@pytest.mark.parametrize("method", [FirstActions, Coordinate])
def test_one_step_ahead_shows_what_pays(method):
    simulator = prepared(NONE, LIKELIHOOD="0.75")
    policy = simulator.policy
    assert play(policy, policy).mean == 0.0
    thinker = thinking(simulator, method())
    played = play(policy, thinker)
    # the first and the third arm at each of four steps
    assert {float(r) for r in played.returns} <= {a + 3.0 * c for a in range(5) for c in range(5)}
    assert played.illegal_actions == 0
    assert [decision.left_base for decision in thinker.decisions] == [True] * 4
    for decision in thinker.decisions:
        assert decision.gain == pytest.approx(0.75 * 4.0, abs=5 * decision.error)
    action, _, _ = thinker.decide(3, START)
    np.testing.assert_array_equal(action["pull"], [True, False, True])


def test_each_finalist_is_another_one(monkeypatch):
    simulator, tested, test = prepared(NONE, LIKELIHOOD="0.75"), [], Halving.test

    def noted(self, finalists, *arguments):
        tested.append(finalists)
        return test(self, finalists, *arguments)

    monkeypatch.setattr(Halving, "test", noted)
    # in each of its rounds the best one so far is compared with others again
    play(simulator.policy, thinking(simulator, Coordinate()))
    assert max(map(len, tested)) > 1
    for finalists in tested:
        assert len(np.unique(finalists, axis=0)) == len(finalists)


@pytest.mark.parametrize("method", [FirstActions, Coordinate])
def test_only_legal_actions_are_played(method):
    simulator = prepared(NONE, MOST="1", RULES="forall_{?a : arm} [pull(?a) => PAYS(?a) < 2];")
    thinker = thinking(simulator, method())
    played = play(simulator.policy, thinker)
    # the arm that pays 3 may not be pulled
    assert played.mean == 4.0
    assert played.illegal_actions == 0


def test_an_optimal_policy_is_not_left():
    simulator = prepared((1, 0, 1))
    thinker = thinking(simulator, Coordinate())
    assert play(simulator.policy, thinker).mean == 16.0
    assert not any(decision.left_base for decision in thinker.decisions)


def test_one_slow_call_is_not_the_last():
    clock = Ticking(0.01)
    simulator = Simulator(lever_policy(NONE, LIKELIHOOD="0.75"), depth=1, clock=clock)
    simulator.prepare(START, SECONDS)
    method = FirstActions()
    method.applies(simulator.components)
    thinker = LookaheadPolicy(simulator, method, 2 * SECONDS, seed=0, clock=clock)
    clock.tick = 5.0
    thinker.decide(0, START)
    clock.tick = 0.01
    for _ in range(15):
        thinker.decide(0, START)
    calls = [decision.calls for decision in thinker.decisions]
    assert 0 in calls
    assert min(calls[-3:]) > 0
    assert all(decision.seconds <= 2 * SECONDS for decision in thinker.decisions[1:])


def test_a_late_call_near_the_end_says_little_of_the_next_episode():
    clock = Ticking(0.01)
    simulator = Simulator(lever_policy(NONE, LIKELIHOOD="0.75"), depth=1, clock=clock)
    simulator.prepare(START, SECONDS)
    candidates = np.zeros((1, 1, 3), np.float32)
    clock.tick = 0.5
    simulator.gains(WIDE, START, 3, candidates, 0)
    # and not so much at each of the four steps
    assert 0.5 < simulator.seconds(WIDE, 0) < 0.7


@pytest.mark.parametrize("call", [0.004, 0.02, 0.04, 0.3])
@pytest.mark.parametrize("method", [FirstActions, Coordinate])
def test_a_decision_ends_in_time(method, call):
    policy, clock, proposer = lever_policy(NONE), Stopped(), method()
    simulator = SlowSimulator(policy, clock, {WIDE: call, NARROW: 0.75 * call})
    assert proposer.applies(simulator.components)
    thinker = LookaheadPolicy(simulator, proposer, 0.25, seed=0, clock=clock)
    action = thinker(0, START)
    (decision,) = thinker.decisions
    assert decision.seconds <= 0.25
    # where not even one call fits, the policy's own action is played
    assert decision.left_base == (call < 0.1)
    assert bool(np.asarray(action["pull"])[2]) == (call < 0.1)


def test_noise_does_not_lead_to_what_returns_less():
    policy, clock = lever_policy((0, 0, 1)), Stopped()
    simulator = SlowSimulator(policy, clock, {WIDE: 0.001, NARROW: 0.001})
    proposer = FirstActions()
    proposer.applies(simulator.components)
    thinker = LookaheadPolicy(simulator, proposer, 0.25, seed=0, clock=clock)
    actions = [thinker(step, START) for step in [0, 1, 2, 3] * 10]
    # without the third arm an action is worse by 1, with noise of deviation 1 in each scenario
    assert all(np.asarray(action["pull"])[2] for action in actions)
    figures = decision_figures(thinker.decisions, 0.25, episodes=10)
    assert figures["decisions"] == 40
    assert figures["within_budget"] == 1.0


@dataclass
class RareLoss(SlowSimulator):
    """Pulling any arm pays 1, but once in a hundred scenarios it loses 1000."""

    def gains(self, kind, state, step, candidates, seed):
        self.clock.now += self.durations[kind]
        is_lost = self.random.random((1, 16)) < 0.01
        paid = np.where(is_lost, -1000.0, 1.0)
        return paid * np.any(candidates[1:] != candidates[0], axis=(1, 2))[:, np.newaxis]


@pytest.mark.parametrize("is_random", [True, False])
def test_a_gain_that_all_scenarios_so_far_share_is_no_certainty(is_random):
    policy, clock = lever_policy(NONE), Stopped()
    durations = {WIDE: 0.002, NARROW: 0.002}
    # in the one case the returns have shown already that chance plays a part
    simulator = RareLoss(policy, clock, durations, is_random=is_random)
    proposer = FirstActions()
    proposer.applies(simulator.components)
    thinker = LookaheadPolicy(simulator, proposer, 0.25, seed=0, clock=clock)
    for _ in range(40):
        thinker.decide(0, START)
    assert sum(decision.left_base for decision in thinker.decisions) <= 2


def test_a_small_gain_that_is_certain_is_taken():
    @dataclass
    class Small(SlowSimulator):
        def gains(self, kind, state, step, candidates, seed):
            return 0.0 * super().gains(kind, state, step, candidates, seed) + 1e-8

    simulator = Small(lever_policy(NONE), Stopped(), {WIDE: 0.01, NARROW: 0.01})
    simulator.may_draw = simulator.is_random = False
    proposer = FirstActions()
    proposer.applies(simulator.components)
    thinker = LookaheadPolicy(simulator, proposer, 0.25, seed=0, clock=simulator.clock)
    thinker.decide(0, START)
    (decision,) = thinker.decisions
    assert decision.left_base
    # one scenario says it all: a call for the search and one for the test
    assert decision.calls == 2


def test_finalists_meet_as_many_scenarios_as_if_returns_had_differed():
    simulator = prepared((1, 0, 1))
    # the model draws from a law whose one value its parameters give
    assert simulator.may_draw
    assert not simulator.is_random
    assert simulator.scenarios(WIDE) == 2
    assert simulator.scenarios(NARROW) >= 128 // 4


def test_a_call_has_no_more_candidates_than_there_are_actions():
    simulator = prepared(NONE, LIKELIHOOD="0.75")
    assert simulator.challengers(WIDE) == 2**3 - 1
    assert simulator.scenarios(WIDE) >= 128 // 2**3
    # nothing is random
    assert prepared((1, 0, 1)).challengers(WIDE) == 2**3 - 1


def test_gains_are_of_the_return_of_the_episode():
    simulator = prepared(NONE, DISCOUNT="0.5")
    thinker = thinking(simulator, FirstActions())
    assert play(simulator.policy, thinker).mean == 4.0 * (1.0 + 0.5 + 0.25 + 0.125)
    assert [decision.gain for decision in thinker.decisions] == [4.0, 2.0, 1.0, 0.5]
