"""A policy whose planner has a preprocessor: its values are saved, checked and read back."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from helpers.mistakes import one_line
from helpers.plan_command import CONFIG, DOMAIN, INSTANCE
from helpers.toys import problem_from

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.start import initial_parameters, unit_hyperparams
from mdpo_rddl.policy.file import load_policy
from mdpo_rddl.policy.policy import Compiled, Policy
from mdpo_rddl.policy.trees import flatten, unflatten

KEY = "preprocessor__"
STATE = {"volume": np.array([2.0, 5.0])}
NET = """
method='JaxDeepReactivePolicy'
method_kwargs={'topology': [3]}
preprocessor='StaticNormalizer'
"""


def config(more=""):
    text = CONFIG.replace("method='JaxStraightLinePlan'", NET + more)
    return PlannerConfig.from_text(text, "here")


def problem(invariants=""):
    kept = "action-preconditions {"
    return problem_from(DOMAIN.replace(kept, invariants + kept) + INSTANCE, horizon=4)


def policy_of(problem, config):
    planner = build_planner(problem, config).planner
    params = initial_parameters(planner, jax.random.PRNGKey(1))
    params = jax.tree.map(lambda leaf: np.asarray(leaf[0]), params)
    hyperparams = jax.tree.map(np.asarray, unit_hyperparams(planner))
    return Policy(problem, config, params, hyperparams, seed=7, compiled=Compiled(planner))


@pytest.fixture(scope="module")
def policy():
    return policy_of(problem(), config("preprocessor_kwargs={'fluent_bounds': {'volume': (0, 9)}}"))


def test_what_is_saved_plays_the_same_with_its_own_values(policy, tmp_path):
    stats = {"volume": (np.float32(-1.0), np.float32(3.0))}
    policy = replace(policy, policy_hyperparams={**policy.policy_hyperparams, KEY: stats})
    policy.save(tmp_path / "p")
    again = Policy.from_saved(load_policy(tmp_path / "p"), policy.problem, "p")
    assert again.policy_hyperparams[KEY] == stats
    for step in range(4):
        np.testing.assert_array_equal(
            again(step, STATE)["fill"], policy(step, STATE)["fill"], strict=True
        )
    configured = replace(policy, policy_hyperparams={"fill": 1.0})
    assert not np.array_equal(configured(0, STATE)["fill"], policy(0, STATE)["fill"])


def test_bounds_of_each_object_and_none_at_all(tmp_path):
    bounded = "state-invariants { forall_{?t : tank} [volume(?t) >= -9.0 ^ volume(?t) <= 9.0]; };"
    for invariants, shapes in ((bounded, [(2,), (2,)]), ("", [])):
        policy = policy_of(problem(invariants), config())
        leaves = jax.tree.leaves(policy.policy_hyperparams[KEY])
        assert [leaf.shape for leaf in leaves] == shapes
        policy.save(tmp_path / "p")
        again = Policy.from_saved(load_policy(tmp_path / "p"), policy.problem, "p")
        assert jax.tree.structure(again.policy_hyperparams) == jax.tree.structure(
            policy.policy_hyperparams
        )
        np.testing.assert_array_equal(again(0, STATE)["fill"], policy(0, STATE)["fill"])


def test_a_file_of_version_0_2_0_stacks_the_two_bounds(policy):
    saved = policy.to_saved()
    hyperparams = {**saved.policy_hyperparams, KEY: {"volume": np.array([0.0, 9.0], np.float32)}}
    again = Policy.from_saved(replace(saved, policy_hyperparams=hyperparams), policy.problem, "p")
    np.testing.assert_array_equal(again(0, STATE)["fill"], policy(0, STATE)["fill"], strict=True)


@pytest.mark.parametrize(
    "stats",
    [
        {},
        {"volume": np.zeros(3, np.float32)},
        {"volume": np.zeros((2, 10**4), np.float32)},
        {"volume": (np.float32(0.0),)},
        {"volume": (np.float32(0.0), np.zeros(10**4, np.float32))},
        {"volume": (np.float32(0.0), np.bool_(True))},
        {"volume": {"[0]": np.float32(0.0), "[1]": np.float32(1.0)}},
        {"other": (np.float32(0.0), np.float32(1.0))},
        np.float32(1.0),
    ],
)
def test_values_of_another_shape_are_refused_before_they_are_used(policy, stats, monkeypatch):
    monkeypatch.setattr(Policy, "__call__", None)
    saved = policy.to_saved()
    hyperparams = {**saved.policy_hyperparams, KEY: stats}
    saved = replace(saved, policy_hyperparams=hyperparams)
    said = one_line(lambda: Policy.from_saved(saved, policy.problem, "here"))
    assert said == f"here: damaged policy file: its hyperparameter {KEY} is not the planner's"


def test_values_that_are_not_finite_or_missing_are_refused(policy):
    saved = policy.to_saved()
    stats = {"volume": (np.float32(0.0), np.float32(np.nan))}
    hyperparams = {**saved.policy_hyperparams, KEY: stats}
    lost = replace(saved, policy_hyperparams=hyperparams)
    said = one_line(lambda: Policy.from_saved(lost, policy.problem, "here"))
    assert said == "here: damaged policy file: it holds numbers that are not finite"
    lost = replace(saved, policy_hyperparams={"fill": np.float32(1.0)})
    said = one_line(lambda: Policy.from_saved(lost, policy.problem, "here"))
    assert said == ("here: damaged policy file: it lacks the values of the planner's preprocessor")


def test_tuples_are_named_by_their_numbers():
    parts = tuple(np.full((), number) for number in range(12))
    flat = flatten({"a": {"b": parts}, "c": np.ones(1)}, "t")
    assert list(flat)[:2] == ["t/a/b/[0]", "t/a/b/[1]"]
    (tree,) = unflatten(flat).values()
    assert jax.tree.structure(tree) == jax.tree.structure({"a": {"b": parts}, "c": 0})
    assert tree["a"]["b"] == parts


@pytest.mark.parametrize("names", [["[1]"], ["[0]", "[2]"], ["[0]", "a"], ["[00]"]])
def test_parts_of_no_tuple_are_refused(names):
    with pytest.raises(ValueError, match=r"is a part of no tuple"):
        unflatten({f"t/{name}": np.ones(1) for name in names})
