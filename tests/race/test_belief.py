"""The vote's arm: a race of its own in slices, whose policies are voted for."""

import time

import numpy as np
from helpers.toys import toy

from mdpo_rddl.planner.config.fitting import scaled, with_memory
from mdpo_rddl.planner.config.presets import auto_preset
from mdpo_rddl.race.arm import Candidate, Context, Judged, Turn
from mdpo_rddl.race.arms.belief import belief_vote
from mdpo_rddl.race.budget import Budget
from mdpo_rddl.race.evaluator import Evaluator
from mdpo_rddl.race.family import Family
from mdpo_rddl.race.probe import probe
from mdpo_rddl.race.race import subordinate
from mdpo_rddl.simulator.simulator import Simulator


def _nothing():
    pass


def context_of(problem):
    simulator = Simulator(problem)
    seen = probe(problem, simulator, 1)
    config = scaled(auto_preset(problem).without_section("Search"), seen)
    family = Family(problem, simulator, with_memory(config, problem), 1, _nothing)
    given = Budget.of(100.0), 1, family, seen.is_certain, _nothing
    return Context(problem, simulator, Evaluator(simulator, 1), *given, race=subordinate)


def test_it_needs_a_hidden_state():
    assert belief_vote().init(context_of(toy("track", START="0.0"))) is None


def test_its_race_goes_on_in_slices_and_a_vote_is_offered_that_pays():
    context, arm = context_of(toy("umbrella")), belief_vote()
    noop = context.family.policy(context.family.noop)
    returns = context.evaluator.more(noop.replicated(), np.zeros(0), _nothing)
    leader = Judged(Candidate("constants", "no-op", noop), returns)
    state = arm.init(context)
    worked = [state.iterations]
    best = returns.mean()
    try:
        # nobody who sees the state does better than one a step
        while state.claim < 20.0 and not state.is_exhausted:
            turn = Turn(time.monotonic() + 0.1, leader, leader)
            state = arm.step(context, state, turn)
            worked.append(state.iterations)
            best = max([best, *(np.mean(each.returns) for each in state.found)])
    finally:
        arm.close(state)
    assert worked == sorted(worked)
    assert state.claim == 20.0
    assert best > returns.mean() + 2.0
    assert state.race.has_ended
    assert state.voted.arm in state.race.leader.candidate.arm
