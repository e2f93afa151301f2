"""Episodes side by side: their ends, errors and returns are those of one environment each."""

import numpy as np
import pytest
from helpers.toy_mdps import lamp
from helpers.toys import toy

from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.load import load_problem, make_environment
from mdpo_rddl.simulator.rollouts import rollout
from mdpo_rddl.simulator.simulator import Simulator

# what the five replicas do at each step, for the two runners
RUNS = np.array([[1.0, 0.0, 0.0, 2.5, 1.0], [0.0, 0.0, -1.0, 0.0, 1.0]])


def run(step, observation):
    return {"run": RUNS}


@pytest.fixture
def track():
    return Simulator(toy("track", START="0.0"))


def test_each_replica_ends_for_itself(track):
    played = rollout(track, run, 5, seed=0)
    # at the finish, at the horizon, off the track, and twice by what was not allowed
    assert played.lengths.tolist() == [3, 4, 2, 2, 3]
    assert played.returns.tolist() == [2.75, 0.0, -2.0, 5.0, 5.5]
    # a limit of each precondition and on the number of actions
    assert played.illegal.tolist() == [0, 0, 0, 2, 3]
    assert not played.errors.any()
    assert played.trajectories is None


def test_the_trajectories_stay_where_they_end(track):
    states, actions, rewards = rollout(track, run, 5, seed=0, keep=True).trajectories
    assert states["at"].shape == (5, 2, 5)
    assert states["at"][:, 0, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 3.0]
    assert states["at"][:, 1, 2].tolist() == [0.0, -1.0, -2.0, -2.0, -2.0]
    assert states["ahead"][:, 0].tolist() == [False, True, True, True, True]
    assert actions["run"].shape == (4, 2, 5)
    np.testing.assert_array_equal(actions["run"][3], RUNS)
    assert rewards[:, 0].tolist() == [1.0, 2.0, 3.0, 0.0]


def test_blocks_play_their_episodes_one_after_the_other(track):
    track.block = 2
    begun = []

    def follow(step, observation):
        if step == 0:
            begun.append(observation["at"].shape[-1])
        first = 2 * (len(begun) - 1)
        return {"run": RUNS[:, first : first + 2]}

    played = rollout(track, follow, 5, seed=0, keep=True)
    assert begun == [2, 2, 1]
    whole = rollout(Simulator(toy("track", START="0.0")), run, 5, seed=0, keep=True)
    for part, other in zip(played[:4], whole[:4], strict=True):
        np.testing.assert_array_equal(part, other)
    for name, value in whole.trajectories.states.items():
        np.testing.assert_array_equal(played.trajectories.states[name], value)
    np.testing.assert_array_equal(played.trajectories.rewards, whole.trajectories.rewards)


def test_episodes_begin_where_they_are_told_to(track):
    begin = {"at": np.array([[2.0, 3.5], [0.0, 0.0]]), "steps": np.zeros(2, int)}
    begin["ahead"] = np.ones(2, bool)
    played = rollout(track, lambda step, seen: {"run": [[0.5], [0.0]]}, begin, seed=0, horizon=3)
    # the second one is over before its first step
    assert played.lengths.tolist() == [2, 0]
    assert played.returns.tolist() == [2.5 + 0.5 * 3.0, 0.0]


def test_a_terminal_initial_state_returns_nothing():
    played = rollout(Simulator(toy("track", START="4.0")), run, 5, seed=0, keep=True)
    assert played.lengths.tolist() == [0] * 5
    assert played.returns.tolist() == [0.0] * 5
    assert played.trajectories.rewards.shape == (0, 5)
    assert played.trajectories.actions["run"].shape == (0, 2, 5)


def test_an_error_is_its_replica_s_own():
    kettle = Simulator(toy("kettle", TERMINATION="heat > 5.0"))
    cool = np.array([False, True])
    played = rollout(kettle, lambda step, seen: {"cool": cool}, 2, seed=0)
    # at 1.125 the heat is no probability: the step is not counted
    assert played.errors.tolist() == [True, False]
    assert played.lengths.tolist() == [3, 8]
    assert played.returns.tolist() == [0.375 + 0.75, -4.0]


def test_the_same_seed_gives_the_same_episodes_and_their_law(tmp_path):
    problem = lamp(tmp_path, 3, discount=0.5)
    simulator = Simulator(problem)

    def press(step, observation):
        return {"press": True}

    played = rollout(simulator, press, 4000, seed=5, horizon=3)
    np.testing.assert_array_equal(
        played.returns, rollout(simulator, press, 4000, seed=5, horizon=3).returns
    )
    assert (played.returns != rollout(simulator, press, 4000, seed=6, horizon=3).returns).any()
    # it is on with 0 at first, then with 0.5
    g = problem.model.discount
    mean = 0.5 * (g + g * g) - 0.125 * (1 + g + g * g)
    error = played.returns.std() / np.sqrt(4000)
    assert abs(played.returns.mean() - mean) < 4 * error


@pytest.mark.parametrize("name", ["CartPole_Discrete_gym", "MountainCar_Continuous_gym"])
def test_returns_and_lengths_are_pyrddlgym_s(name):
    problem = load_problem(name, "0", horizon=60)
    env = make_environment(problem)
    env.action_space.seed(1)
    simulator = Simulator(problem)
    (action,) = simulator.actions
    drawn = np.array([[env.action_space.sample()[action] for _ in range(60)] for _ in range(4)])
    drawn = drawn.reshape(4, 60).astype(float)
    played = rollout(simulator, lambda step, seen: {action: drawn[:, step]}, 4, seed=0)
    idle = np.asarray(env.sampler.noop_actions[action])
    for episode in range(4):
        env.reset(seed=0)
        total, length, factor = 0.0, 0, 1.0
        while not env.done:
            value = drawn[episode, length].reshape(idle.shape).astype(idle.dtype)
            _, reward, *_ = env.step({action: value})
            total += factor * reward
            factor *= env.discount
            length += 1
        assert played.lengths[episode] == length
        assert played.returns[episode] == total


def test_a_fluent_that_is_no_action_is_named(track):
    with pytest.raises(InputError, match="no action fluent 'fly', the problem has: run"):
        rollout(track, lambda step, seen: {"fly": 1.0}, 2, seed=0)
