"""Trials of methods: gains that are rare are seen, chance is no gain, and the time is kept."""

from dataclasses import dataclass

import numpy as np
import pytest
from helpers.clocks import Stopped
from helpers.levers import NONE, lever_policy
from helpers.slow_simulator import SlowSimulator

from mdpo_rddl.policy.lookahead.coordinate import Coordinate
from mdpo_rddl.policy.lookahead.driver import LookaheadPolicy
from mdpo_rddl.policy.lookahead.first_actions import FirstActions
from mdpo_rddl.policy.lookahead.simulator import NARROW, WIDE
from mdpo_rddl.policy.lookahead.trials import (
    FEWEST_STATES,
    MOST_STATES,
    NO_TIME,
    Trials,
)

SECONDS = 0.2


def states(every):
    """Of a hundred states so many have pulled the first arm."""
    return [(n % 4, {"pulled": np.array([n % every == 0, False, False])}) for n in range(100)]


@dataclass
class RareSimulator(SlowSimulator):
    """The third arm pays only where the first was pulled; others lose nothing and gain nothing."""

    def gains(self, kind, state, step, candidates, seed):
        paid = super().gains(kind, state, step, candidates, seed)
        extra = candidates[1:, 0, 2] - candidates[0, 0, 2]
        return paid - (not state["pulled"][0]) * extra[:, np.newaxis]


def trials(methods=(FirstActions,)):
    clock = Stopped()
    simulator = RareSimulator(lever_policy(NONE), clock, {WIDE: 0.01, NARROW: 0.01})
    thinkers = []
    for make in methods:
        method = make()
        assert method.applies(simulator.components)
        thinkers.append(LookaheadPolicy(simulator, method, SECONDS, seed=0, clock=clock))
    return Trials(thinkers, simulator, SECONDS, clock), clock


def test_gains_at_few_states_are_seen():
    tried, _ = trials()
    (trial,) = tried.at(states(8), np.inf)
    assert trial.states <= MOST_STATES
    assert trial.mean == pytest.approx(1 / 8, abs=0.05)
    # over the states these gains vary so much that ten of them, say, would tell nothing
    spread = np.sqrt(1 / 8 * (1 - 1 / 8) / 10)
    assert 2 * spread > 1 / 8
    assert trial.error < spread / 5
    assert trial.pays


def test_decisions_that_chance_has_led_gain_nothing_on_fresh_scenarios():
    """Arms one and two cost nothing here: only by chance are they pulled or left."""
    tried, _ = trials()
    (trial,) = tried.at(states(8)[1:8] * 10, np.inf)
    assert trial.states == MOST_STATES
    assert 0.0 < trial.error < 0.05
    assert abs(trial.mean) < 4 * trial.error


def test_trials_end_where_the_best_method_is_clear():
    tried, clock = trials()
    (trial,) = tried.at(states(1), np.inf)
    assert 10 <= trial.states < MOST_STATES
    assert trial.mean == pytest.approx(1.0, abs=0.1)
    # two methods that gain as much are compared as long as there are states
    tried, clock = trials((FirstActions, Coordinate))
    both = tried.at(states(1), np.inf)
    assert [trial.states for trial in both] == [MOST_STATES] * 2
    assert clock.now < 2 * MOST_STATES * 1.2 * SECONDS


class Lasting(FirstActions):
    """Pulls the second arm at the next step too, which changes nothing."""

    def propose(self, gains, random):
        first = super().propose(gains, random)
        return np.concatenate([first, np.tile([0.0, 1.0, 0.0], (len(first), 1, 1))], axis=1)


@pytest.mark.parametrize(("is_random", "expected"), [(True, (3 / 2 + 1) / 4), (False, 1.0)])
def test_a_plan_counts_by_its_gain_a_step_but_where_it_is_kept(is_random, expected):
    # at the last of four steps there is no next one
    tried, _ = trials((Lasting,))
    tried.simulator.is_random = is_random
    (trial,) = tried.at(states(1)[:40], np.inf)
    assert trial.mean == pytest.approx(expected, abs=0.1)


def test_one_or_two_states_decide_nothing():
    for count, note in ((1, NO_TIME), (FEWEST_STATES - 1, NO_TIME), (FEWEST_STATES, "")):
        tried, _ = trials()
        (trial,) = tried.at(states(1)[:count], np.inf)
        assert trial.note == note
        assert trial.pays == (note == "")


def test_where_time_is_short_decisions_are_too():
    for within, expected in ((3.0, (16, 30)), (60.0, (60, 60))):
        tried, clock = trials()
        (trial,) = tried.at(states(8)[1:8] * 10, within)
        assert clock.now <= within
        # in play no more than 15 would fit
        assert expected[0] <= trial.states <= expected[1]
    tried, clock = trials()
    (trial,) = tried.at(states(8), 0.1)
    assert (trial.mean, trial.note) == (None, NO_TIME)
    assert clock.now < 0.2


def test_nothing_of_a_trial_is_left_for_an_episode():
    clock, method, state = Stopped(), FirstActions(), {"pulled": np.zeros(3, bool)}
    durations = {WIDE: 0.001, NARROW: 0.001}
    simulator = SlowSimulator(lever_policy(NONE), clock, durations, may_draw=False)
    method.applies(simulator.components)
    thinker = LookaheadPolicy(simulator, method, 0.25, seed=0, clock=clock)
    (trial,) = Trials([thinker], simulator, 0.25, clock).at([(2, state)] * 3, np.inf)
    assert trial.pays
    # without time for a search there is nothing but the plan
    durations[WIDE] = 1.0
    assert not thinker(0, state)["pull"].any()
