"""PPO of stable-baselines3 on the vector environment; `make test-clients` has it installed."""

import runpy

import numpy as np
import pytest
from helpers.problems import ROOT

pytest.importorskip("stable_baselines3", reason="torch is large: make test-clients")

EXAMPLE = ROOT / "examples" / "reinforcement" / "ppo.py"


@pytest.fixture(scope="module")
def example():
    return runpy.run_path(str(EXAMPLE))


def test_it_learns_to_hold_the_pole(example):
    learnt = example["train"](lambda: example["make"]("CartPole_Discrete_gym", "0", 32), 16_000)
    # an untrained network drops it
    assert learnt["before"] < 60.0
    assert learnt["after"] > 1.5 * learnt["before"]


def test_it_trains_on_real_actions_beside_pyrddlgym_rl_s_environment(example):
    ours, theirs = example["compare"]("HVAC_ippc2023", "1", 4096, 64, 256)[2:]
    assert ours.startswith("| mdpo_rddl.make_vec | 64 | 4,096 |")
    assert theirs.startswith("| pyRDDLGym-rl | 1 | 256 |")


def test_an_end_is_told_as_stable_baselines3_wants_it(example):
    env = example["make"]("HVAC_ippc2023", "1", 2)
    env.seed(3)
    begun = env.reset()
    actions = np.zeros((2, *env.action_space.shape))
    for _ in range(env.vec.unwrapped.simulator.problem.horizon):
        observations, _, done, infos = env.step(actions)
    assert done.all()
    np.testing.assert_array_equal(observations, begun)
    for info in infos:
        assert info["TimeLimit.truncated"]
        assert (info["terminal_observation"] != begun[0]).any()
