"""Parts of a feedback policy without an effect are left out, and it plays the same."""

import jax
import numpy as np
import pytest
from helpers.problems import assert_same_bits, tiny_files

from mdpo_rddl.planner.exact.exact import compile_exact_returns
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.planner.plans.parts import idle_parts, open_loop, with_effect
from mdpo_rddl.problem.load import load_problem

SHAPE = FeedbackShape(topology=(3,), plan=True, squares=True, lifted=2, pairs=100)
PARTS = {"shared", "own", "lifted", "plan", "net"}
KEY = jax.random.PRNGKey(0)


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    problem = load_problem(*tiny_files(tmp_path_factory.mktemp("tiny"), spread=1.0))
    arguments = {"pgpe": None, "batch_size_train": 1, "batch_size_test": 1}
    return MDPOPlanner(problem.model, FeedbackPlan(SHAPE), **arguments)


def drawn(planner, path_matches):
    """The no-op's parameters, but for the leaves whose path matches: these are drawn."""
    random = np.random.default_rng(5)

    def leaf(path, value):
        keys = [entry.key for entry in path]
        return random.normal(size=value.shape, scale=0.3) if path_matches(keys) else value

    params = jax.tree_util.tree_map_with_path(leaf, planner.feedback_plan.noop(0))
    assert params.keys() == PARTS
    return jax.tree.map(lambda value: np.asarray(value, np.float32), params)


def returns(planner, params):
    one = jax.tree.map(lambda value: value[np.newaxis], params)
    return np.asarray(compile_exact_returns(planner, 4)(KEY, one))


def is_open(keys):
    return keys[0] == "plan" or (keys[-1] == "bias" and keys[0] == "own")


def is_rule(keys):
    return keys[0] in ("shared", "own")


def test_what_follows_a_plan_plays_the_same_without_all_else(planner):
    params = drawn(planner, is_open)
    alone = open_loop(params)
    assert {name: set(entries) for name, entries in alone["own"].items()} == {
        name: {"bias"} for name in params["own"]
    }
    assert alone.keys() == {"own", "plan"}
    played = returns(planner, alone)
    assert np.any(played != returns(planner, planner.feedback_plan.noop(0)))
    np.testing.assert_allclose(played, returns(planner, params), rtol=1e-5)
    assert_same_bits(with_effect(params), alone)
    without = {name: part for name, part in params.items() if name != "plan"}
    assert open_loop(without).keys() == {"own"}


@pytest.mark.parametrize(
    "last", ["gain on x", "gains of pairs on x", "output", "output_push", "shared"]
)
def test_a_policy_that_reacts_has_no_open_loop(planner, last):
    found = set()

    def reacts(keys):
        found.update(keys[-1:])
        return keys[-1] == last or last == "shared" == keys[0]

    params = drawn(planner, reacts)
    assert last in found | {"shared"}
    assert open_loop(params) is None


def test_a_rule_plays_the_same_without_plan_and_net(planner):
    params = drawn(planner, is_rule)
    idle = idle_parts(params)
    assert idle == {"lifted", "plan", "net"}
    alone = with_effect(params)
    assert alone.keys() == params.keys() - idle
    np.testing.assert_allclose(returns(planner, alone), returns(planner, params), rtol=1e-5)
    # what has an effect stays
    whole = drawn(planner, lambda keys: True)
    assert idle_parts(whole) == set()
    assert with_effect(whole).keys() == PARTS
    assert idle_parts(drawn(planner, is_open)) == {"lifted", "net"}
