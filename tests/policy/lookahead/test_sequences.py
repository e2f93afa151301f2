"""Changes of the policy's actions at several steps together."""

import functools

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.levers import NONE, lever_policy

from mdpo_rddl.policy.lookahead.base import Gain, Situation
from mdpo_rddl.policy.lookahead.components import Components
from mdpo_rddl.policy.lookahead.coordinate import Coordinate
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.sequences import Sequences
from mdpo_rddl.policy.lookahead.simulator import Simulator
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment

SECONDS, DEPTH = 0.5, 4
START = {"pulled": np.zeros(3, bool)}
# the arm that pays 3 can be pulled after the one that costs 2
KEYED = "forall_{?a : arm} [(pull(?a) ^ PAYS(?a) > 2) => exists_{?b : arm} [KEY]];"
KEYED = KEYED.replace("KEY", "PAYS(?b) < 0 ^ pulled(?b)")


@functools.cache
def prepared(**words):
    simulator = Simulator(lever_policy(NONE, **words), depth=DEPTH, clock=Ticking(0.01))
    simulator.prepare(START, SECONDS)
    return simulator


def returned(simulator, method):
    assert method.applies(simulator.components)
    thinker = LookaheadPolicy(simulator, method, 4 * SECONDS, seed=0, clock=Ticking(0.01))
    played = evaluate(make_environment(simulator.policy.problem), thinker, episodes=1, seed=0)
    assert played.illegal_actions == 0
    return played.mean


def sequences(most="pos-inf", base=NONE):
    method = Sequences(depth=DEPTH)
    assert method.applies(Components.of(lever_policy(MOST=most).planner))
    method.begin(Situation(np.array(base, np.float32), 20, lambda *_: None))
    return method


def propose(method, gains=(), seed=0):
    return method.propose(gains, np.random.default_rng(seed))


def test_what_pays_only_after_a_cost_is_found():
    simulator = prepared(RULES=KEYED)
    # the first arm pays 1 at each of four steps; no single change shows more
    assert returned(simulator, Coordinate()) == 4.0
    # at best the second arm is pulled at three steps and the third at the three after these
    assert 4.0 < returned(simulator, Sequences(depth=DEPTH)) <= 4.0 - 3 * 2.0 + 3 * 3.0


def test_one_component_at_a_time_where_no_more_may_differ():
    simulator = prepared(RULES=KEYED, MOST="1")
    # the second arm and the third in turn return as much as nothing but the first
    assert returned(simulator, Sequences(depth=DEPTH)) == pytest.approx(4.0, abs=1.0)
    for candidate in propose(sequences(most="1")):
        assert np.sum(candidate[0]) <= 1
        for later in candidate[1:]:
            # the policy decides, or the whole action is given, in which one arm is pulled at most
            assert not np.any(later) or (np.all(later > 0) and np.sum(later == 2) <= 1)


def test_single_changes_of_the_first_action_come_first():
    first = propose(sequences(base=(1, 0, 0)))
    single = [tuple(map(int, c[0])) for c in first if not np.any(c[1:])]
    assert {(0, 0, 0), (1, 1, 0), (1, 0, 1)} <= set(single)
    assert len(np.unique(first, axis=0)) == len(first)
    base = np.zeros((DEPTH, 3))
    base[0] = 1, 0, 0
    assert not any(np.array_equal(candidate, base) for candidate in first)


def test_later_rounds_are_about_what_gained():
    method = sequences()
    propose(method)
    elite = np.zeros((DEPTH, 3), np.float32)
    elite[2] = 0, 2, 2
    found = propose(method, [Gain(elite, 2.0, 0.1), Gain(np.ones_like(elite), -1.0, 0.1)])
    kept = np.mean([np.sum(candidate[2] == elite[2]) >= 2 for candidate in found])
    assert kept > 0.5


def test_what_was_found_is_known_at_the_next_step_until_the_episode_ends():
    method = sequences()
    propose(method)
    plan = np.zeros((DEPTH, 3), np.float32)
    plan[0], plan[1], plan[3] = (1, 0, 0), (0, 0, 2), (1, 0, 0)
    method.shift(plan)
    method.begin(Situation(np.array((1, 0, 0), np.float32), 20, lambda *_: None))
    first = propose(method)[0]
    # its second step is the first now: the policy pulls the first arm, the plan the third too
    np.testing.assert_array_equal(first, [(1, 0, 1), (0, 0, 0), (1, 0, 0), (0, 0, 0)])
    method.reset()
    method.begin(Situation(np.zeros(3, np.float32), 20, lambda *_: None))
    assert not np.any(propose(method)[0, 1:])


def test_an_episode_may_begin_with_a_plan():
    method, base = sequences(), np.zeros(3, np.float32)
    plan = np.zeros((DEPTH + 2, 3), np.float32)
    plan[0], plan[1], plan[DEPTH] = (2, 0, 0), (0, 0, 2), (1, 0, 0)
    method.resume(plan)
    expected = plan[:DEPTH].copy()
    expected[0] = 1, 0, 0
    method.begin(Situation(base, 20, lambda *_: None))
    np.testing.assert_array_equal(propose(method)[0], expected)
    # a longer candidate has what comes after its own steps
    method.shift(np.concatenate([expected, plan[DEPTH:]]))
    method.begin(Situation(base, 20, lambda *_: None))
    np.testing.assert_array_equal(propose(method)[0, -1], plan[DEPTH])


def test_nothing_is_proposed_for_real_actions_alone():
    real = Components(
        parts={"push": slice(0, 1)},
        values=((),),
        is_real=np.ones(1, bool),
        noop=np.zeros(1),
        lower=-np.ones(1),
        upper=np.ones(1),
        units=np.ones(1),
        most=1,
    )
    assert not Sequences().applies(real)
