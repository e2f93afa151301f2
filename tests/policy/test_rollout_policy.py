"""What goes on with a policy in compiled rollouts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.toys import toy

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.fitting import greedy
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.policy.policy import Compiled, Policy

KEY = jax.random.PRNGKey(3)
FEEDBACK = auto_preset("").without_section("Search")
LEVER = {
    "LIKELIHOOD": "0.15",
    "DISCOUNT": "0.5",
    "TERMINATION": "false",
    "MOST": "pos-inf",
    "RULES": "forall_{?a : arm} [pull(?a) => true];",
}


def policy_of(config):
    problem = toy("lever", **LEVER)
    planner = build_planner(problem, config).planner
    params = planner.plan.initializer(KEY, {}, None)
    return Policy(problem, config, params, {}, seed=0, compiled=Compiled(planner))


@pytest.fixture(scope="module")
def sampling():
    return policy_of(greedy(FEEDBACK).with_policy_arguments(samples=64))


def pulled(policy, play):
    state = {"pulled": jnp.zeros(3, bool)}
    played = jax.jit(jax.vmap(lambda key: play(key, policy.params, {}, 0, state, {})["pull"]))
    return np.asarray(played(jax.random.split(KEY, 40)))[:, 0]


def test_a_greedy_policy_samples_less_in_rollouts(sampling):
    # the first arm pays in one of four samples half of the time, and almost surely in one of 64
    assert np.mean(pulled(sampling, sampling.planner.plan.test_policy)) > 0.9
    assert 0.2 < np.mean(pulled(sampling, sampling.rollout_policy)) < 0.8


def test_another_policy_is_the_same_in_rollouts():
    policy = policy_of(FEEDBACK)
    assert policy.rollout_policy is policy.planner.legal_policy
