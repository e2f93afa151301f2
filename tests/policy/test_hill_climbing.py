"""Searches for the way out where no step comes nearer to a goal."""

import numpy as np
import pytest
from helpers.couriers import courier, tower

from mdpo_rddl.policy import hill_climbing
from mdpo_rddl.policy.ground_actions import GroundActions
from mdpo_rddl.policy.hill_climbing import HillClimbing
from mdpo_rddl.problem.delete_relaxation.distances import Distances, Prices
from mdpo_rddl.problem.delete_relaxation.relaxed import relaxed
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits
from mdpo_rddl.problem.enumeration.model import open_model

LIMITS = EnumerationLimits(1e9)
PRICES = Prices()


class Climbing:
    """Searches in a problem of which the only goal promises 1."""

    def __init__(self, problem):
        self.model = open_model(problem, LIMITS)
        self.actions = GroundActions(self.model)
        self.distances = Distances(relaxed(self.model, LIMITS), self.model.horizon)
        self.climbing = HillClimbing(self.distances, self.actions)

    def start(self):
        return np.array([int(value) for value in self.model.first])[:, np.newaxis]

    def names(self, proposal):
        grounds = list(self.model.actions)
        return {grounds[number] for number, _ in proposal}

    def first(self, states, promised=1.0, left=20):
        goals = len(self.distances.worths)
        promised = np.full((goals, states.shape[1]), promised)
        return self.climbing.first_steps(states, promised, left, PRICES)

    def way(self, states, goal=0, left=20):
        return self.climbing._searched(states, [(0, goal)], (left, PRICES))[0]

    def played(self, states, proposals):
        sampler = self.actions.sampler
        uniform = np.full((sampler.draws, len(proposals)), 0.5)
        return sampler.step(states, self.actions.values(proposals), uniform).states


@pytest.fixture
def blocks():
    return Climbing(tower())


def test_the_first_step_is_that_of_the_shortest_way(blocks):
    ((place, proposal),) = blocks.first(blocks.start())
    # the upmost block stands where it is wanted, on one that has to be moved
    assert place == 0
    assert blocks.names(proposal) == {("put-down", (2,))}


def test_a_goal_that_promises_nothing_is_not_searched_for(blocks):
    assert blocks.first(blocks.start(), promised=0.0) == []


def test_where_a_step_comes_nearer_nothing_is_said():
    climbing = Climbing(courier())
    assert climbing.first(climbing.start()) == []


def test_likely_events_happen():
    # 4 times of 5 it has the parcel after a pick, and is a step nearer; were that not to happen, no
    # way would be found
    climbing = Climbing(courier())
    steps, proposal = climbing.way(climbing.start())
    assert (steps, climbing.names(proposal)) == (1, {("pick", ())})


def test_a_way_has_no_more_steps_than_are_left(blocks):
    steps, _ = blocks.way(blocks.start())
    assert steps > 1
    assert blocks.way(blocks.start(), left=steps - 1) is None
    assert blocks.way(blocks.start(), left=steps) == blocks.way(blocks.start())


def test_a_step_that_ends_the_episode_comes_nearer_too():
    climbing = Climbing(tower(ends=True))
    on = [("on", pair) for pair in ((0, 3), (1, 0))]
    state = np.array([[int(variable in on)] for variable in climbing.model.variables])
    steps, proposal = climbing.way(state)
    assert (steps, climbing.names(proposal)) == (1, {("put", (2, 1))})


def test_states_are_decided_alike_alone_and_side_by_side(blocks):
    start = blocks.start()
    ((_, down),) = blocks.first(start)
    after = blocks.played(start, [down])
    together = blocks.first(np.concatenate([after, start, after], axis=1))
    alone = [Climbing(tower()).first(each) for each in (after, start, after)]
    assert dict(together) == {place: found[0][1] for place, found in enumerate(alone) if found}


def test_much_at_once_is_done_in_parts(blocks, monkeypatch):
    expected = blocks.first(blocks.start())
    monkeypatch.setattr(hill_climbing, "MOST_VALUES", 1)
    computed, whole = [], Distances.__call__

    def counted(self, states, prices):
        computed.append(states.shape[1])
        return whole(self, states, prices)

    monkeypatch.setattr(Distances, "__call__", counted)
    assert Climbing(tower()).first(blocks.start()) == expected
    assert set(computed) == {1}


@pytest.mark.parametrize(("bound", "most"), [("_MOST_STATES", 2), ("_MOST_STEPS", 2)])
def test_a_way_that_is_too_long_is_none(blocks, monkeypatch, bound, most):
    monkeypatch.setattr(hill_climbing, bound, most)
    assert blocks.first(blocks.start()) == []


def test_what_it_has_seen_is_not_computed_again(blocks, monkeypatch):
    expected = blocks.first(blocks.start())

    def computed(*given):
        raise AssertionError("computed again")

    monkeypatch.setattr(Distances, "__call__", computed)
    assert blocks.first(blocks.start()) == expected


def test_what_it_has_seen_does_not_grow_for_ever(blocks, monkeypatch):
    start = blocks.start()
    ((_, down),) = blocks.first(start)
    after = blocks.played(start, [down])
    expected = blocks.first(after)
    together = len(blocks.climbing._known)
    monkeypatch.setattr(hill_climbing, "_REMEMBERED", 0)
    forgetful = Climbing(tower())
    forgetful.first(start)
    assert forgetful.first(after) == expected
    assert len(forgetful.climbing._known) < together
