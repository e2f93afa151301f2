"""The gradient beside a race: where it applies, with what it begins, that it finds something."""

import time

import numpy as np
import pytest
from helpers.lakes import write_lake
from helpers.toys import toy

from mdpo_rddl.planner.config.fitting import scaled
from mdpo_rddl.planner.config.presets import auto_preset
from mdpo_rddl.planner.training.beside import PhasedTraining, Task
from mdpo_rddl.race.arm import Candidate, Context, Judged, Turn
from mdpo_rddl.race.arms import gradients
from mdpo_rddl.race.arms.gradients import feedback_gradient, plan_gradient
from mdpo_rddl.race.budget import Budget
from mdpo_rddl.race.evaluator import Evaluator
from mdpo_rddl.race.family import Family
from mdpo_rddl.race.probe import probe
from mdpo_rddl.simulator.rollouts import rollout
from mdpo_rddl.simulator.simulator import Simulator


def _nothing():
    pass


def context_of(problem, seconds=100.0):
    simulator = Simulator(problem)
    seen = probe(problem, simulator, 1)
    config = scaled(auto_preset(problem).without_section("Search"), seen)
    config = config.with_policy_arguments(topology=[], cosines=0, pairs=0)
    config = config.with_values("Planner", batch_size_train=2, batch_size_test=8)
    family = Family(problem, simulator, config, 1, _nothing)
    budget = Budget.of(seconds)
    evaluator = Evaluator(simulator, 1)
    certain = seen.is_certain
    return Context(problem, simulator, evaluator, budget, 1, family, certain, _nothing)


def turn_of(context, params, seconds=0.2):
    policy = context.family.policy(params)
    returns = context.evaluator.more(policy.replicated(), np.zeros(0), _nothing)
    judged = Judged(Candidate("constants", "no-op", policy), returns)
    return Turn(time.monotonic() + seconds, judged, judged)


class _NoChild:
    """What is asked of a child."""

    def __init__(self, serve):
        self.asked = []

    def ask(self, message):
        self.asked.append(message)


def test_each_problem_has_one_scope_at_most(monkeypatch, tmp_path):
    monkeypatch.setattr(gradients, "Child", _NoChild)
    lake, track = write_lake(tmp_path), toy("track", START="0.0")
    applies = {
        (name, arm.name): arm.init(context_of(problem)) is not None
        for name, problem in {"lake": lake, "track": track, "umbrella": toy("umbrella")}.items()
        for arm in (feedback_gradient(), plan_gradient())
    }
    assert {both for both, is_one in applies.items() if is_one} == {
        ("lake", "gradient"),
        ("track", "plan by gradient"),
    }
    assert feedback_gradient().init(context_of(lake, seconds=5.0)) is None


def test_a_plan_begins_with_what_the_leader_plays():
    context = context_of(toy("track", START="0.0"))
    random = np.random.default_rng(0)
    shape = context.family.noop["plan"]["run"].shape
    played = random.uniform(-0.3, 0.2, shape).astype(np.float32)
    played[:, 0] = 0.0  # one runner alone may run
    params, parent = gradients.played_plan(
        context, turn_of(context, {**context.family.noop, "plan": {"run": played}})
    )
    assert parent.label == "no-op"
    np.testing.assert_allclose(params["plan"]["run"], played, atol=1e-6)
    both = [context.family.policy(each).replicated() for each in (params, {"plan": params["plan"]})]
    first, second = (rollout(context.simulator, play, 1, 0).returns for play in both)
    assert first == second


def test_phases_begin_with_steps_around_those_that_found_the_best(tmp_path):
    context = context_of(write_lake(tmp_path))
    task = Task(
        context.problem,
        context.family.config,
        context.family.noop,
        (0.5, 1.0) * 2,
        (1.0,) * 4,
        0,
        9.0,
    )
    training = PhasedTraining(task)
    noop = training.advance(0.0)
    assert (noop["phases"], noop["iterations"] > 0) == (1, True)
    best = training._result
    training.begin(context.family.noop)
    # of four restarts two have half of the step size
    assert training._step == (0.5, 1.0, 0.5, 1.0)[best.restart]
    found = training.advance(0.5)
    assert found["phases"] == 2
    assert found["iterations"] > noop["iterations"]


@pytest.mark.parametrize("cores", [1, 2])
def test_a_child_finds_something_better_than_the_no_op(monkeypatch, tmp_path, cores):
    monkeypatch.setattr(gradients, "usable_cores", lambda: cores)
    context, arm = context_of(write_lake(tmp_path)), feedback_gradient()
    state, found = arm.init(context), []
    turn = turn_of(context, context.family.noop)
    try:
        while not found and not state.is_exhausted:
            turn = turn._replace(until=time.monotonic() + 0.2)
            state = arm.step(context, state, turn)
            found += state.found
            time.sleep(0.01)
    finally:
        arm.close(state)
    assert not state.is_exhausted, state.details
    assert np.mean(found[0].returns) > np.mean(turn.leader.returns)
    assert found[0].uses_noise
    assert found[0].parents == ("constants",)
