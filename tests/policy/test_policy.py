"""A policy with all that belongs to it: saved, read back and played."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from helpers.lakes import preset, write_lake
from helpers.problems import tiny_files

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.policy.file import load_policy, save_policy
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.problem.load import load_problem

STATE = {"depth": np.array(450.0)}


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    problem = write_lake(tmp_path_factory.mktemp("lake"))
    config = preset(1.0).without_section("Search")
    planner = build_planner(problem, config).planner
    params = planner.plan.initializer(jax.random.PRNGKey(0), {}, None)
    random = np.random.default_rng(0)
    params = jax.tree.map(lambda leaf: random.normal(size=leaf.shape).astype(leaf.dtype), params)
    return Policy(problem, config, planner, params, {"pump": 1.0}, seed=7)


def test_what_is_saved_plays_the_same(policy, tmp_path):
    path = tmp_path / "policy.safetensors"
    save_policy(path, policy.to_saved())
    again = Policy.from_saved(load_policy(path), policy.problem, str(path))
    assert again.config.sections == policy.config.sections
    assert again.seed == 7
    actions = [policy(step, STATE)["pump"] for step in range(8)]
    assert [again(step, STATE)["pump"] for step in range(8)] == actions
    assert len(set(map(float, actions))) == 8


def test_other_parameters_are_another_policy(policy):
    zeros = jax.tree.map(np.zeros_like, policy.params)
    assert policy.with_params(zeros)(0, STATE)["pump"] == 0.0
    assert policy(0, STATE)["pump"] != 0.0


def test_a_policy_of_another_problem_or_shape_is_refused(policy, tmp_path):
    saved = policy.to_saved()
    other = load_problem(*tiny_files(tmp_path))
    with pytest.raises(InputError, match=r"^here: saved for .*lake/one.*, not for"):
        Policy.from_saved(saved, other, "here")
    shorter = jax.tree.map(lambda leaf: leaf[:-1] if leaf.ndim else leaf, saved.params)
    with pytest.raises(InputError, match=r"^here: damaged policy file"):
        Policy.from_saved(replace(saved, params=shorter), policy.problem, "here")
