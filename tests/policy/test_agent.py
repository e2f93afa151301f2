"""A policy as an agent of pyRDDLGym: in either kind of environment, counted step by step."""

from functools import partial

import numpy as np
import pytest
from helpers.mistakes import one_line
from helpers.problems import tiny_files
from pyRDDLGym import RDDLEnv
from pyRDDLGym.core.policy import BaseAgent

from mdpo_rddl.policy.agent import PolicyAgent
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import load_problem, make_environment


class HalfWay(PolicyAgent):
    """Pushes half the way to the goal; too far in the last step."""

    def __init__(self, problem):
        self.problem = problem
        self.steps = []

    def __call__(self, step, observation):
        self.steps.append(step)
        return {"push": np.full(2, 9.0) if step == 3 else 0.5 * (0.5 - observation["x"])}


@pytest.fixture
def files(tmp_path):
    return tiny_files(tmp_path, horizon=4, spread=0.3)


@pytest.fixture
def agent(files):
    return HalfWay(load_problem(*files))


def test_it_plays_both_kinds_of_environments_alike(agent, files):
    assert isinstance(agent, BaseAgent)
    results = []
    for vectorized in (False, True):
        env = RDDLEnv(*files, vectorized=vectorized, enforce_action_constraints=True)
        results.append(agent.evaluate(env, episodes=3, seed=5))
    np.testing.assert_array_equal(results[0].returns, results[1].returns)
    assert agent.steps == [0, 1, 2, 3] * 6
    assert results[0].lengths.tolist() == [4, 4, 4]
    # a box is clipped to, which is no illegal action
    assert results[0].illegal_actions == 0


def test_an_evaluation_is_what_a_base_agent_tells(agent, files, capsys):
    env = RDDLEnv(*files, vectorized=True)
    theirs = BaseAgent.evaluate(agent, env, episodes=4, seed=1)
    ours = agent.evaluate(env, 4, False, False, 1)
    assert dict(ours) == pytest.approx(theirs)
    assert set(theirs) == {"mean", "median", "min", "max", "std"}
    assert capsys.readouterr().out == ""
    agent.evaluate(env, verbose=True)
    assert "step   = 3" in capsys.readouterr().out


def test_without_an_environment_it_is_our_evaluation(agent):
    found = agent.evaluate(episodes=3, seed=2)
    theirs = evaluate(make_environment(agent.problem), agent, 3, 2)
    np.testing.assert_array_equal(found.returns, theirs.returns)
    assert len(agent.evaluate().returns) == 50
    assert one_line(partial(agent.evaluate, render=True)).startswith("verbose and render need")
    env = make_environment(agent.problem)
    for given in ({}, {"env": env}):
        for episodes in (0, -1):
            said = one_line(partial(agent.evaluate, episodes=episodes, **given))
            assert said == f"episodes must be at least 1, got {episodes}"
        assert (
            one_line(partial(agent.evaluate, seed=-1, **given)) == "seed must be at least 0, got -1"
        )


def test_ground_fluents_in_and_out(agent):
    agent.reset()
    action = agent.sample_action({"x___u1": 0.0, "x___u2": 0.5})
    assert action == {"push___u1": 0.25, "push___u2": 0.0}
    assert type(action["push___u1"]) is float
    lacking = partial(agent.sample_action, {"x___u1": 0.0})
    assert one_line(lacking) == "the observation lacks x___u2"
    unknown = partial(agent.sample_action, {"x___u1": 0.0, "x___u2": 0.0, "x___u3": 0.0})
    assert one_line(unknown) == "the observation has the unknown fluent x___u3"


def test_steps_are_counted_whatever_interrupts_them(agent, monkeypatch):
    def interrupted(step, observation):
        raise TimeoutError

    agent.reset()
    with monkeypatch.context() as patch:
        patch.setattr(HalfWay, "__call__", lambda self, step, observation: interrupted(step, {}))
        with pytest.raises(TimeoutError):
            agent.sample_action()
    np.testing.assert_array_equal(agent.sample_action()["push"], [0.25, 0.25])
    for _ in range(5):
        agent.sample_action()
    assert agent.steps == [1, 2, 3, 3, 3, 3]


def test_gymnasiums_loop(agent, files):
    env = RDDLEnv(*files, vectorized=True)
    state, _ = env.reset(seed=0)
    agent.reset()
    done = False
    while not done:
        state, _, terminated, truncated, _ = env.step(agent.sample_action(state))
        done = terminated or truncated
    assert agent.steps == [0, 1, 2, 3]


def test_many_observations_at_once(agent):
    actions = agent.batch(0, {"x": np.array([[0.0, 0.5], [1.0, 0.5], [0.5, 0.5]])})
    np.testing.assert_array_equal(actions["push"], [[0.25, 0.0], [-0.25, 0.0], [0.0, 0.0]])
