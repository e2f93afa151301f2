"""What the ground model solves, as arms: the optimum that ends a race, and relaxed plans."""

import time
from typing import Any

import numpy as np
import pytest
from helpers import toy_mdps as toys
from helpers.couriers import courier, hidden_courier
from helpers.lakes import write_lake

from mdpo_rddl import load_policy
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.problem.load import load_problem
from mdpo_rddl.race import beside
from mdpo_rddl.race.arm import Arm, Candidate, Context, Turn
from mdpo_rddl.race.arms import ground
from mdpo_rddl.race.budget import Budget
from mdpo_rddl.race.evaluator import Evaluator
from mdpo_rddl.race.race import RaceOptions, race
from mdpo_rddl.simulator.simulator import Simulator

ARMS = [ground.dynamic_programming, ground.relaxed_plans]
SEED = 3


@pytest.fixture(params=["process", "thread"])
def place(request, monkeypatch):
    if request.param == "thread":
        monkeypatch.setattr(beside, "_forked", lambda *given: None)


def context(problem, seconds=60.0) -> Context:
    simulator = Simulator(problem)
    nothing: Any = None
    return Context(
        problem=problem,
        simulator=simulator,
        evaluator=Evaluator(simulator, SEED),
        budget=Budget.of(seconds),
        seed=SEED,
        family=nothing,
        certain=False,
        on_iteration=lambda: None,
    )


def ended(arm, given):
    """All candidates of an arm, and its last state."""
    leader: Any = None
    state, found = arm.init(given), []
    while not state.is_exhausted:
        ready = state.is_ready
        state = arm.step(given, state, Turn(0.0, leader, None))
        assert ready or not state.found
        found += state.found
        if not state.is_ready:
            time.sleep(0.001)
    arm.close(state)
    return found, state


@pytest.mark.usefixtures("place")
def test_the_optimum_of_a_walk_is_proven(tmp_path):
    given = context(toys.walk(tmp_path, 6))
    (candidate,), state = ended(ground.dynamic_programming(), given)
    assert candidate.policy.optimum.value == pytest.approx(-2.9375, abs=1e-12)
    assert state.claim == candidate.policy.optimum.value
    assert state.details == {"proven": True, "states": 5}
    assert candidate.policy.seed == SEED
    returns = given.evaluator.more(candidate.policy.replicated(), np.zeros(1024), lambda: None)
    error = np.std(returns[1024:]) / 32.0
    assert abs(np.mean(returns[1024:]) + 2.9375) < 4.0 * error
    candidate.policy.save(tmp_path / "optimum.npz")
    again = load_policy(tmp_path / "optimum.npz")
    assert again.optimum.value == candidate.policy.optimum.value


def test_a_proven_optimum_ends_the_race_though_another_policy_returns_as_much(tmp_path):
    problem = toys.walk(tmp_path, 6)
    optimum = find_optimum(problem, 60.0)

    def given(family):
        return [Candidate("given", "the same table without the claim", Unproven(optimum.policy()))]

    config = auto_preset(problem.domain_name)
    options = RaceOptions(initial=given, arms=lambda: [ground.dynamic_programming(), idle()])
    outcome = race(problem, config, Budget.of(1e6), SEED, options)
    *before, last = outcome.points
    assert max(point.mean for point in before) >= last.mean
    assert last.became_incumbent
    assert outcome.chosen.arm == ground.DYNAMIC_PROGRAMMING
    assert outcome.optimum.value == optimum.value


class Unproven:
    """Plays as another policy, of which nothing is known."""

    def __init__(self, policy):
        self.replicated = policy.replicated


def idle() -> Arm:
    """An arm that would go on for ever."""
    state = ground.GroundState(None, is_ready=True)
    return Arm("idle", lambda given: state, lambda given, state, turn: state)


@pytest.mark.usefixtures("place")
def test_relaxed_plans_are_known_by_the_evaluators_own_episodes():
    problem = courier()
    given = context(problem)
    found, state = ended(ground.relaxed_plans(), given)
    best = find_optimum(problem, 60.0).value
    assert found
    assert state.claim == pytest.approx(best, abs=0.3)
    for candidate in found:
        play, again = candidate.policy.replicated(), np.zeros(0)
        while len(again) < len(candidate.returns):
            again = given.evaluator.more(play, again, lambda: None)
        np.testing.assert_array_equal(again, candidate.returns)
        assert candidate.policy.claim.value == pytest.approx(np.mean(again))
        assert candidate.policy.claim.episodes == len(again)
    # each is better than the one before it, in the same episodes
    means = [np.mean(each.returns) for each in found]
    assert means == sorted(means)


def test_relaxed_plans_of_a_large_problem(monkeypatch):
    monkeypatch.setattr(ground, "_EPISODES", 16)
    given = context(load_problem("CooperativeRecon_ippc2018", "1"))
    found, _ = ended(ground.relaxed_plans(), given)
    assert np.mean(found[-1].returns) > 7.0


@pytest.mark.parametrize("arm", ARMS)
def test_what_is_not_discrete_or_not_observed_has_no_ground_model(tmp_path, arm):
    for problem in (write_lake(tmp_path), hidden_courier()):
        assert arm().init(context(problem)) is None


@pytest.mark.parametrize("arm", ARMS)
def test_time_that_is_over_is_said(tmp_path, arm):
    found, state = ended(arm(), context(toys.walk(tmp_path, 6), seconds=0.0))
    assert not found
    assert state.details["cause"]


def test_memory_that_does_not_suffice_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr(ground, "_MOST_MEMORY", 2**24)
    problem = toys.one_way(tmp_path, 8, 6, 60)
    found, state = ended(ground.dynamic_programming(), context(problem))
    assert not found
    assert "allocate" in state.details["cause"] or "more than" in state.details["cause"]


@pytest.mark.parametrize("arm", ARMS)
def test_closing_ends_the_process(tmp_path, arm):
    state = arm().init(context(toys.walk(tmp_path, 6)))
    process = state.beside._process
    arm().close(state)
    assert not process.is_alive()
