"""A policy with all that belongs to it: saved, read back and played."""

import copy
import pickle
from dataclasses import replace

import jax
import numpy as np
import pytest
from helpers.lakes import preset, write_lake
from helpers.mistakes import one_line
from helpers.problems import tiny_files
from helpers.x64 import enable_x64

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.policy.file import load_policy, save_policy
from mdpo_rddl.policy.load import load_policy as load_alone
from mdpo_rddl.policy.policy import Compiled, Policy
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
    return Policy(problem, config, params, {"pump": 1.0}, seed=7, compiled=Compiled(planner))


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


@pytest.mark.parametrize("kind", [bool, np.int64, np.float64])
def test_parameters_of_another_type_are_refused(policy, kind):
    params = jax.tree.map(lambda leaf: leaf.astype(kind), policy.params)
    said = one_line(
        lambda: Policy.from_saved(replace(policy.to_saved(), params=params), policy.problem, "here")
    )
    assert said == (
        f"here: damaged policy file: its parameters are {np.dtype(kind)}, not as the planner's"
    )


@pytest.mark.parametrize("value", [np.zeros(100), np.zeros(1), np.array(True), {"a": np.ones(())}])
def test_hyperparameters_that_are_no_numbers_are_refused(policy, value):
    saved = replace(policy.to_saved(), policy_hyperparams={"pump": value})
    said = one_line(lambda: Policy.from_saved(saved, policy.problem, "here"))
    assert said == "here: damaged policy file: its hyperparameter pump is not the planner's"


def test_a_file_stands_alone_and_plays_the_same_bits(policy, tmp_path):
    candidates = (
        {"candidate": "a <b>", "mean_return": -2.5, "became_incumbent": True, "seconds": 1.0},
        {"candidate": "c", "mean_return": -3.0, "became_incumbent": False, "seconds": 2.0},
    )
    policy = replace(policy, candidates=candidates)
    domain = policy.problem.domain_path
    text = domain.read_text()
    domain.unlink()
    try:
        policy.save(tmp_path / "policy.safetensors")
        for path in (tmp_path / "policy.safetensors", str(tmp_path)):
            again = load_alone(path)
            without_times = [{**each} for each in candidates]
            for each in without_times:
                del each["seconds"]
            assert list(again.candidates) == without_times
            assert again.returns.tolist() == [-2.5]
            ours, theirs = policy.evaluate(episodes=3), again.evaluate(episodes=3)
            np.testing.assert_array_equal(ours.returns, theirs.returns)
    finally:
        domain.write_text(text)
    assert "a &lt;b&gt;, 1.0 s" in policy._repr_html_()
    assert "a &lt;b&gt;" in again._repr_html_()
    assert "-2.50" in again._repr_html_()
    # one line, without the arrays and the RDDL
    assert repr(again).startswith(f"<Policy for {again.problem.label}: ")
    assert len(repr(again)) < 100
    assert "cpfs" not in repr(again.problem)


def test_a_file_does_not_depend_on_the_time_that_planning_took(policy, tmp_path):
    found = {"candidate": "a", "mean_return": -2.5, "became_incumbent": True}
    for name, seconds in (("one", 1.0), ("other", 2.0)):
        timed = replace(policy, candidates=({**found, "seconds": seconds},))
        timed.save(tmp_path / name)
    other = replace(policy, candidates=({**found, "mean_return": -3.0},))
    other.save(tmp_path / "third")
    contents = [(tmp_path / name).read_bytes() for name in ("one", "other", "third")]
    assert contents[0] == contents[1] != contents[2]


def test_a_file_without_its_problem_is_refused_in_a_line(policy, tmp_path):
    save_policy(tmp_path / "old", replace(policy.to_saved(), source=None))
    with pytest.raises(InputError, match=r"old: holds no RDDL: evaluate its run folder"):
        load_alone(tmp_path / "old")


def test_a_batch_is_as_one_after_the_other(policy):
    depths = np.array([[450.0], [500.0], [700.0]])
    together = policy.batch(2, {"depth": depths})["pump"]
    single = [policy(2, {"depth": depth})["pump"] for depth in depths]
    np.testing.assert_allclose(together, single, rtol=1e-6)


def test_the_precision_is_the_planners_whatever_jax_is_set_to(policy):
    before = policy(0, STATE)["pump"]
    with enable_x64(True):
        assert policy(0, STATE)["pump"] == before
        assert jax.config.jax_enable_x64


def test_a_pickled_policy_plays_the_same(policy):
    again = pickle.loads(pickle.dumps(policy))
    actions = [policy(step, STATE)["pump"] for step in range(8)]
    assert [again(step, STATE)["pump"] for step in range(8)] == actions
    assert again.problem.digest == policy.problem.digest


def test_a_copy_needs_no_compilation(policy):
    assert copy.copy(policy).planner is policy.planner


@pytest.mark.parametrize(
    ("step", "observation", "said"),
    [
        (0.5, STATE, "the step must be an integer from 0 to 7, got 0.5"),
        (8, STATE, "the step must be an integer from 0 to 7, got 8"),
        (0, {}, "the observation lacks depth"),
        (0, None, "the observation must be a mapping of fluents to values, got NoneType"),
        (0, [450.0], "the observation must be a mapping of fluents to values, got list"),
    ],
)
def test_what_is_no_step_or_no_observation_is_refused(policy, step, observation, said):
    assert one_line(lambda: policy(step, observation)) == said
    assert one_line(lambda: policy.batch(step, observation)) == said


def test_an_agent_that_is_shown_nothing_of_the_problem_says_so(policy):
    policy.reset()
    assert one_line(lambda: policy.sample_action({})) == "the observation lacks depth"
