"""A share of the trial's time for each decision: what is saved is kept, and none runs out."""

import numpy as np
import pytest
from helpers.clocks import Stopped
from helpers.levers import NONE, lever_policy
from helpers.slow_simulator import SlowSimulator

from mdpo_rddl.ipc import thinking
from mdpo_rddl.ipc.planner import Improving, Restorable, Timed
from mdpo_rddl.ipc.thinking import ThinkingMDPO
from mdpo_rddl.policy.lookahead.choice import Choice
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.first_actions import FirstActions
from mdpo_rddl.policy.lookahead.simulator import NARROW, WIDE
from mdpo_rddl.problem.episode import Verdict

START = {"pulled": np.zeros(3, bool)}


@pytest.fixture
def ready(monkeypatch):
    """A planner after its preparation, whose calls take so long by a clock of its own."""

    def make(trial_seconds, call, chosen=True):
        policy, clock = lever_policy(NONE), Stopped()

        def choose(policy, seconds, within, clock):
            simulator = SlowSimulator(policy, clock, {WIDE: call, NARROW: call})
            method = FirstActions()
            method.applies(simulator.components)
            thinker = LookaheadPolicy(simulator, method, seconds, 0, clock)
            return Choice(thinker if chosen else None, [], "", 0.0)

        monkeypatch.setattr(thinking, "choose", choose)
        monkeypatch.setattr(ThinkingMDPO, "_find", lambda *_: policy)
        planner = ThinkingMDPO(clock)
        planner.play_within(trial_seconds)
        planner.prepare(policy.problem, 60.0, 0)
        planner.improve(15.0)
        return planner, clock

    return make


def play(planner, clock, between=0.0):
    rng, ends = np.random.default_rng(0), []
    for step in range(4):
        action = planner.act(step, START, rng)
        clock.now += between
        ends.append(clock.now)
    return action, ends


def test_it_can_be_kept_and_wants_to_know_a_trials_time():
    assert isinstance(ThinkingMDPO(), Restorable)
    assert isinstance(ThinkingMDPO(), Timed)


def test_whether_to_think_is_tried_when_the_policy_can_be_kept(monkeypatch, tmp_path):
    policy, asked = lever_policy(NONE), list[float]()

    def choose(policy, seconds, within, clock):
        asked.append(within)
        return Choice(None, [], "", 0.0)

    monkeypatch.setattr(thinking, "choose", choose)
    monkeypatch.setattr(ThinkingMDPO, "_find", lambda *_: policy)
    planner = ThinkingMDPO(Stopped())
    assert isinstance(planner, Improving)
    planner.play_within(10.0)
    planner.prepare(policy.problem, 60.0, 0)
    planner.save(tmp_path)
    assert asked == []
    planner.improve(-1.0)
    assert asked == []
    planner.improve(10.0)
    # less a margin, since the process is ended then
    assert asked == [pytest.approx(8.5)]


def test_no_trial_runs_out_of_time(ready):
    planner, clock = ready(trial_seconds=2.0, call=0.01)
    action, ends = play(planner, clock)
    assert action["pull"][2]
    assert ends[-1] <= 0.7 * 2.0
    # a second trial has its own time
    began = clock.now
    assert play(planner, clock)[1][-1] - began <= 0.7 * 2.0


@pytest.mark.parametrize("is_restored", [False, True])
def test_a_policy_plays_alone_until_it_is_improved(ready, is_restored, tmp_path):
    planner, _ = ready(8.0, 0.01)
    planner.save(tmp_path)
    assert planner.thinker is not None
    problem = lever_policy(NONE).problem
    if is_restored:
        planner.restore(problem, tmp_path)
    else:
        planner.prepare(problem, 60.0, 0)
    assert planner.thinker is None
    assert planner.note == "nothing was tried"


def test_the_thinker_is_told_what_is_played_instead(ready, monkeypatch):
    planner, _ = ready(trial_seconds=2.0, call=0.01)
    other, told = {"pull": np.array([True, False, False])}, []
    monkeypatch.setattr(planner._moves, "rule", lambda *_: Verdict(other, True, True))
    monkeypatch.setattr(planner.thinker, "was_played", told.append)
    assert planner.act(0, START, np.random.default_rng(0)) is other
    assert told[-1] is other


def test_a_slow_environment_leaves_less_to_think(ready):
    planner, clock = ready(trial_seconds=2.0, call=0.01)
    _, ends = play(planner, clock, between=0.25)
    assert ends[-1] <= 0.7 * 2.0
    seconds = [decision.seconds for decision in planner._thinker.decisions]
    assert seconds[-1] < 0.5 * seconds[0]


def test_time_that_was_saved_is_there_for_later_steps(ready):
    planner, clock = ready(trial_seconds=2.0, call=0.01)
    planner._trial_began = clock.now
    # as if the first three decisions had taken no time
    planner.act(3, START, np.random.default_rng(0))
    saved = planner._thinker.decisions[0].seconds
    planner.act(0, START, np.random.default_rng(0))
    assert saved > 1.5 * planner._thinker.decisions[1].seconds


def test_without_time_or_gain_the_policy_plays(ready):
    for planner, clock in (ready(2.0, 0.01, chosen=False), ready(0.0, 0.01)):
        action, ends = play(planner, clock)
        assert ends[-1] == 0.0
        assert not np.any(action["pull"])
