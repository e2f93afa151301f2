"""The vector environment against pyRDDLGym's own, one for each episode, in Gymnasium's loop."""

import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import DictInfoToList, FlattenObservation, RecordEpisodeStatistics
from helpers.toy_mdps import lamp
from helpers.toys import toy

import mdpo_rddl
from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.simulator.vector_env import make_vec

MODES = list(AutoresetMode)


@pytest.fixture
def track():
    return toy("track", START="0.0")


def as_trees_equal(ours, theirs):
    assert ours.keys() == theirs.keys()
    for name, value in theirs.items():
        np.testing.assert_array_equal(ours[name], value)
        assert ours[name].dtype == np.asarray(value).dtype


def theirs(problem, mode, count):
    def make():
        env = make_environment(problem)
        spaces = env.observation_space

        def shaped(observation):
            # fluents without parameters come in other shapes than their spaces'
            return {n: np.reshape(value, spaces[n].shape) for n, value in observation.items()}

        return gymnasium.wrappers.TransformObservation(env, shaped, spaces)

    return SyncVectorEnv([make] * count, autoreset_mode=mode)


@pytest.mark.parametrize("mode", MODES)
def test_steps_and_ends_are_those_of_gymnasium_s_sync_vector_env(track, mode):
    count = 6
    vec, sync = make_vec(track, num_envs=count, autoreset_mode=mode), theirs(track, mode, count)
    assert vec.metadata["autoreset_mode"] is mode
    for space in ("observation_space", "action_space"):
        assert getattr(vec, space) == getattr(sync, space)
        assert getattr(vec, f"single_{space}") == getattr(sync, f"single_{space}")
    as_trees_equal(vec.reset(seed=3)[0], sync.reset(seed=3)[0])
    draws = np.random.default_rng(0)
    ends = np.zeros(3, int)
    for _ in range(25):
        # one runner at a time, as max-nondef-actions wants it
        moves = draws.uniform(-1.0, 2.0, (count, 2)) * np.eye(2)[draws.integers(0, 2, count)]
        observations, rewards, terminated, truncated, info = vec.step({"run": moves})
        others, *expected, sync_info = sync.step({"run": moves})
        as_trees_equal(observations, others)
        for ours, other in zip((rewards, terminated, truncated), expected, strict=True):
            np.testing.assert_array_equal(ours, other, strict=True)
        assert not info["error"].any()
        ends += [terminated.sum(), truncated.sum(), (terminated & truncated).sum()]
        if mode is AutoresetMode.SAME_STEP and "final_obs" in sync_info:
            np.testing.assert_array_equal(info["_final_obs"], sync_info["_final_obs"])
            for number in np.flatnonzero(sync_info["_final_obs"]):
                ours, other = info["final_obs"][number], sync_info["final_obs"][number]
                for name, value in other.items():
                    np.testing.assert_array_equal(np.ravel(ours[name]), np.float32(value).ravel())
            np.testing.assert_array_equal(info["_final_info"], sync_info["_final_obs"])
        over = terminated | truncated
        if mode is AutoresetMode.DISABLED and over.any():
            with pytest.raises(ResetNeeded):
                vec.step({"run": moves})
            begun, _ = vec.reset(options={"reset_mask": over})
            as_trees_equal(begun, sync.reset(options={"reset_mask": over})[0])
    assert (ends > 0).all()


def test_spaces_hold_what_is_observed_also_of_fluents_without_parameters():
    vec = make_vec("CartPole_Discrete_gym", 0, num_envs=3)
    observations, _ = vec.reset(seed=0)
    assert observations["pos"].shape == (3, 1)
    assert vec.observation_space.contains(observations)
    force = {"force-side": np.array([1, 0, 1])}
    assert vec.action_space.contains({"force-side": np.array([1, 0, 1], np.int32)})
    observations, *_ = vec.step(force)
    assert vec.observation_space.contains(observations)
    assert observations["vel"][0] == observations["vel"][2] > observations["vel"][1]


def test_objects_are_numbers():
    vec = make_vec("Elevators", 0, num_envs=2)
    assert vec.observation_space.contains(vec.reset(seed=0)[0])


def test_missing_fluents_are_the_no_op(track):
    vec = make_vec(track, num_envs=2)
    vec.reset(seed=0)
    for actions in ({}, None):
        observations, rewards, *_ = vec.step(actions)
        assert rewards.tolist() == [0.0, 0.0]
    assert observations["steps"].ravel().tolist() == [2, 2]


def test_a_seed_gives_the_same_episodes(tmp_path):
    vec = make_vec(lamp(tmp_path, 9), num_envs=20)

    def episodes(seed):
        vec.reset(seed=seed)
        return np.array([vec.step({"press": np.ones(20)})[0]["on"] for _ in range(5)])

    first = episodes(1)
    np.testing.assert_array_equal(first, episodes(1))
    assert vec.np_random_seed == 1
    assert (first != episodes(2)).any()
    assert (first != episodes(None)).any()
    listed = episodes(list(range(20)))
    np.testing.assert_array_equal(listed, episodes(list(range(20))))
    assert (listed != episodes(list(range(1, 21)))).any()
    # replicas draw for themselves
    assert (first != first[:, :1]).any()
    with pytest.raises(ValueError, match="20 episodes need as many seeds, not 2"):
        vec.reset(seed=[1, 2])


def test_episodes_go_on_from_a_state_that_was_kept(track, tmp_path):
    vec, many = make_vec(track, num_envs=2), make_vec(track, num_envs=5)
    vec.reset(seed=0)
    vec.step({"run": [[1.0, 0.0], [0.0, 2.0]]})
    kept = vec.get_state()
    following = vec.step({"run": [[2.0, 0.0], [0.0, 0.5]]})
    # the copy has stayed what it was
    assert kept.steps.tolist() == [1, 1]
    as_trees_equal(vec.set_state(kept), {**following[0], **vec._shown(kept.fluents)})
    again = vec.step({"run": [[2.0, 0.0], [0.0, 0.5]]})
    as_trees_equal(again[0], following[0])
    for ours, other in zip(again[1:4], following[1:4], strict=True):
        np.testing.assert_array_equal(ours, other)
    # in five replicas from the second one, with its counter of steps
    seen = many.set_state(kept.replicas([1]))
    assert seen["at"].tolist() == [[0.0, 2.0]] * 5
    for step in range(3):
        _, _, terminated, truncated, _ = many.step({})
        assert not terminated.any()
        assert truncated.all() == (step == 2)
    # and an end that was reported is kept, too
    many.set_state(many.get_state())
    observations, _, _, truncated, _ = many.step({})
    assert observations["steps"].ravel().tolist() == [0] * 5
    assert not truncated.any()
    with pytest.raises(InputError, match="another problem"):
        make_vec(lamp(tmp_path, 9), num_envs=2).set_state(kept)
    with pytest.raises(InputError, match=r"the state of at has the shape \(2, 2\), not \(2, 5\)"):
        many.set_state(kept)


def test_one_replica_s_error_is_its_own():
    vec = make_vec(toy("kettle", TERMINATION="heat > 5.0"), num_envs=2)
    vec.reset(seed=0)
    cool = {"cool": np.array([0, 1])}
    for _ in range(3):
        *_, truncated, info = vec.step(cool)
        assert not truncated.any()
    observations, rewards, terminated, truncated, info = vec.step(cool)
    assert info["error"].tolist() == truncated.tolist() == [True, False]
    assert not terminated.any()
    assert rewards.tolist() == [0.0, -0.5]
    assert observations["heat"].ravel().tolist() == [1.125, 0.0]
    observations, *_, info = vec.step(cool)
    assert observations["heat"].ravel().tolist() == [0.0, 0.0]
    assert not info["error"].any()


@pytest.mark.parametrize("enforces", [False, True])
def test_illegal_actions_are_told_or_end_the_episode(track, enforces):
    vec = make_vec(track, num_envs=3, enforce_action_constraints=enforces)
    vec.reset(seed=0)
    # too fast, both at once, and neither
    actions = {"run": [[2.5, 0.0], [1.0, 1.0], [1.0, 0.0]]}
    observations, rewards, _, truncated, info = vec.step(actions)
    assert info["illegal"].tolist() == [True, True, False]
    if enforces:
        assert info["error"].tolist() == truncated.tolist() == [True, True, False]
        assert rewards.tolist() == [0.0, 0.0, 1.0]
        assert observations["at"].tolist() == [[0.0, 0.0], [0.0, 0.0], [1.0, 0.0]]
    else:
        assert not info["error"].any()
        assert rewards.tolist() == [2.5, 2.0, 1.0]


@pytest.mark.parametrize("mode", MODES)
def test_an_episode_that_begins_at_its_end_is_one_empty_step(mode):
    vec = make_vec(toy("track", START="4.0"), num_envs=2, autoreset_mode=mode)
    vec.reset(seed=0)
    for _ in range(2):
        observations, rewards, terminated, truncated, _ = vec.step({"run": np.ones((2, 2))})
        assert observations["at"].tolist() == [[4.0, 4.0]] * 2
        assert rewards.tolist() == [0.0, 0.0]
        assert terminated.all()
        assert not truncated.any()
        if mode is AutoresetMode.NEXT_STEP:
            assert not vec.step({})[2].any()
        if mode is AutoresetMode.DISABLED:
            vec.reset(options={"reset_mask": np.ones(2, bool)})


def test_gymnasium_s_wrappers_and_its_make_vec_take_it(track):
    made = gymnasium.make_vec(
        "mdpo_rddl.simulator:mdpo_rddl/RDDL-v0", num_envs=4, problem="HVAC_ippc2023", instance=1
    )
    assert made.unwrapped.num_envs == 4
    vec = RecordEpisodeStatistics(FlattenObservation(make_vec(track, num_envs=3)))
    observations, _ = vec.reset(seed=0)
    assert observations.shape == (3, 4)
    run = {"run": [[1.0, 0.0], [0.0, -1.0], [0.0, 0.0]]}
    infos = [vec.step(run)[-1] for _ in range(3)]
    # the second one has left the track at its second step, the first one is at the finish
    assert infos[1]["episode"]["r"][1] == -3.0
    assert infos[2]["episode"]["r"][0] == 6.0
    listed = DictInfoToList(make_vec(track, num_envs=3))
    listed.reset(seed=0)
    assert [each["illegal"] for each in listed.step(run)[-1]] == [False] * 3


def test_a_pyrddlgym_environment_is_taken_with_its_horizon_and_functions(tmp_path):
    domain, instance = tmp_path / "d.rddl", tmp_path / "i.rddl"
    domain.write_text(
        "domain outside { types { cell : object; };"
        " pvariables { x(cell) : { state-fluent, real, default = 1.0 };"
        " add : { action-fluent, real, default = 0.0 }; };"
        " cpfs { x'(?c) = $twice[?c](x(_)) + add; };"
        " reward = sum_{?c : cell} [x(?c)]; }"
    )
    instance.write_text(
        "non-fluents nf { domain = outside; objects { cell : {c1, c2}; }; }"
        " instance one { domain = outside; non-fluents = nf; max-nondef-actions = pos-inf;"
        " horizon = 9; discount = 1.0; }"
    )
    functions = {"twice": lambda x: 2.0 * x}
    paths = str(domain), str(instance)
    vec = make_vec(*paths, num_envs=2, functions=functions)
    vec.reset(seed=0)
    assert vec.step({"add": np.array([0.5, 1.0])})[0]["x"].tolist() == [[2.5] * 2, [3.0] * 2]
    env = gymnasium.Wrapper(
        mdpo_rddl.make_environment(vec.simulator.problem, functions=functions)
    ).unwrapped
    env.domain_text, env.instance_text = paths
    env.horizon = 1
    taken = make_vec(env, num_envs=2)
    taken.reset(seed=0)
    assert taken.step({})[3].all()
    with pytest.raises(InputError, match="twice"):
        make_vec(*paths)


@pytest.mark.parametrize(
    ("actions", "cause"),
    [
        ({"fly": np.ones((2, 2))}, "no action fluent 'fly', the problem has: run"),
        ({"run": np.ones((2, 3))}, r"actions run have the shape \(2, 3\), not \(2, 2\)"),
        ({"run": 1.0}, r"actions run have the shape \(\), not \(2, 2\)"),
    ],
)
def test_mistakes_in_actions_are_named(track, actions, cause):
    vec = make_vec(track, num_envs=2)
    with pytest.raises(ResetNeeded):
        vec.step({})
    vec.reset()
    with pytest.raises(InputError, match=cause):
        vec.step(actions)


def test_mistakes_in_the_arguments_are_named(track):
    for arguments, cause in (
        ({"num_envs": 0}, "num_envs must be an integer above 0, got 0"),
        ({"autoreset_mode": "never"}, "autoreset_mode must be one of NextStep, SameStep, Disabled"),
        ({"instance": 1}, "an instance does not go with a Problem"),
    ):
        with pytest.raises(InputError, match=cause):
            make_vec(track, **arguments)
    with pytest.raises(InputError, match="got dict"):
        make_vec({})
    with pytest.raises(ValueError, match="reset_mask"):
        make_vec(track, num_envs=2).reset(options={"reset_mask": [True, False, True]})


def test_jax_is_not_imported():
    code = (
        "import sys, mdpo_rddl;"
        "mdpo_rddl.make_vec('HVAC_ippc2023', 4, num_envs=1024).reset();"
        "print('jax' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
