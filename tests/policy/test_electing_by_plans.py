"""A vote of relaxed plans, which are made in the most likely states of a belief."""

import dataclasses
import time
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.hidden_courier import idle, planning

import mdpo_rddl
from mdpo_rddl.policy import electing_by_plans
from mdpo_rddl.policy.electing_by_plans import election_by_plans
from mdpo_rddl.policy.lookahead.belief import Believer
from mdpo_rddl.policy.lookahead.choice import PLANS, choose
from mdpo_rddl.policy.lookahead.first_actions import FirstActions
from mdpo_rddl.policy.lookahead.qmdp import try_qmdp
from mdpo_rddl.problem.load import make_environment


def told(actions, asked=None):
    """Plans that are given beforehand: of each state, a number, its action."""

    def actions_in(step, states):
        numbers = np.asarray(states["at"])
        if asked is not None:
            asked.append((step, numbers.tolist()))
        return {"go": np.array([actions[number] for number in numbers])}

    return SimpleNamespace(actions_in=actions_in)


def test_each_state_has_as_many_voices_as_particles():
    elect = election_by_plans(told({0: [1, 0], 1: [0, 1], 2: [0, 1]}))
    for counts, action in {(4, 2, 3): [0, 1], (6, 2, 3): [1, 0], (0, 0, 1): [0, 1]}.items():
        particles = {"at": np.repeat(np.arange(3), counts)}
        assert elect(None, 2, particles)["go"].tolist() == action


def test_plans_are_made_in_the_most_likely_states_alone(monkeypatch):
    monkeypatch.setattr(electing_by_plans, "_MOST_STATES", 2)
    asked = []
    elect = election_by_plans(told({0: [0], 1: [1], 2: [0], 3: [0]}, asked))
    # one and all others would have more voices
    assert elect(None, 5, {"at": np.repeat(np.arange(4), [3, 6, 2, 4])})["go"].tolist() == [1]
    assert asked == [(5, [1, 3])]


@pytest.fixture(scope="module")
def policy():
    """The vote of relaxed plans of the underlying MDP."""
    return idle().voting_with(planning())


def played(policy, steps=8):
    env = make_environment(policy.problem)
    policy.reset()
    state, found = env.reset(seed=0)[0], []
    for _ in range(steps):
        actions = policy.sample_action(state)
        found.append({name for name, value in actions.items() if np.any(value)})
        state = env.step(actions)[0]
    return found


def test_the_parcel_is_handed_over_though_nobody_sees_it(policy):
    mean = policy.evaluate(episodes=20, seed=1).mean
    assert mean > 0.8 * planning().evaluate(episodes=20, seed=1).mean > 4.0


def test_it_is_loaded_as_it_was(policy, tmp_path):
    path = tmp_path / "policy.safetensors"
    policy.save(path)
    loaded = mdpo_rddl.load_policy(path)
    assert loaded.votes
    assert loaded.saved_underlying == policy.saved_underlying
    assert played(loaded) == played(policy)


def test_it_does_not_think(policy):
    choice = choose(policy, 0.5)
    assert (choice.policy, choice.note) == (None, PLANS)


def test_who_knows_it_and_does_not_vote_thinks_without_it(policy):
    alone = Believer(dataclasses.replace(policy, votes=False))
    assert try_qmdp(alone, [FirstActions()], (0.1, np.inf), time.monotonic) == (None, [])
