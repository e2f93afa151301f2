"""Boxes of numeric actions, against what the environment calls legal."""

import itertools

import numpy as np

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.problem.implications import is_box
from mdpo_rddl.problem.legality import Referee, action_box
from mdpo_rddl.problem.load import load_problem, make_environment

DOMAIN = """
domain boxes {{
    types {{ x: object; y: {{@y1, @y2}}; }};
    pvariables {{
        M(x, y): {{ non-fluent, int, default = 1 }};
        N(x): {{ non-fluent, int, default = 2 }};
        s: {{ state-fluent, {kind}, default = {zero} }};
        a(x, y): {{ action-fluent, {kind}, default = {zero} }};
        f(x, x): {{ action-fluent, {kind}, default = {zero} }};
        n: {{ action-fluent, {kind}, default = {zero} }};
    }};
    cpfs {{ s' = s; }};
    reward = (sum_{{?x: x, ?y: y}} a(?x, ?y) * M(?x, ?y)) + (sum_{{?x: x, ?z: x}} f(?x, ?z)) + n;
    action-preconditions {{
        forall_{{?x: x, ?y: y}} [a(?x, ?y) >= 0];
        forall_{{?x: x, ?z: x}} [f(?x, ?z) >= 0 ^ f(?x, ?z) <= 1];
        n >= 0;
        {rules}
    }};
}}
"""
INSTANCE = """
non-fluents nf {
    domain = boxes;
    objects { x: {x1, x2}; };
    non-fluents { M(x1, @y2) = 3; N(x2) = 1; };
}
instance one { domain = boxes; non-fluents = nf; horizon = 1; discount = 1.0; }
"""
TRANSPOSED = "forall_{?y: y, ?x: x} [a(?x, ?y) <= M(?x, ?y)];"
DIAGONAL = "forall_{?x: x} [f(?x, ?x) <= 0];"
SMALLEST = "forall_{?x: x} [n <= N(?x)];"
PARTIAL = "forall_{?y: y, ?x: x} [N(?x) >= a(?x, ?y)];"
ONE = "forall_{?x: x} [a(?x, @y2) <= N(?x)]; forall_{?x: x} [a(?x, @y1) < 2];"


def problem(folder, *rules, kind="int"):
    zero = {"int": "0", "real": "0.0"}[kind]
    text = DOMAIN.format(rules="\n".join(rules), kind=kind, zero=zero)
    paths = folder / "domain.rddl", folder / "instance.rddl"
    for path, content in zip(paths, (text, INSTANCE), strict=True):
        path.write_text(content)
    return load_problem(*map(str, paths))


def upper(found, name):
    return action_box(make_environment(found))[name][1]


def test_limits_are_in_the_order_of_the_parameters(tmp_path):
    found = problem(tmp_path, TRANSPOSED)
    np.testing.assert_array_equal(upper(found, "a"), [[1, 3], [1, 1]])
    assert all(is_box(found.model, one) for one in found.model.preconditions)


def test_limits_that_differ_in_another_variable_hold_together(tmp_path):
    # of ints pyRDDLGym's own box has another shape than the action, which it refuses
    assert upper(problem(tmp_path, SMALLEST, kind="real"), "n") == 1
    np.testing.assert_array_equal(upper(problem(tmp_path, PARTIAL), "a"), [[2, 2], [1, 1]])


def test_objects_that_are_named_have_limits_of_their_own(tmp_path):
    limits = upper(problem(tmp_path, ONE), "a")
    np.testing.assert_allclose(limits, [[2, 2], [2, 1]], atol=1e-4)


def test_what_holds_for_one_object_in_two_places_is_no_box(tmp_path):
    found = problem(tmp_path, DIAGONAL)
    np.testing.assert_array_equal(upper(found, "f"), np.ones((2, 2)))
    assert [is_box(found.model, one) for one in found.model.preconditions] == [True] * 3 + [False]
    env = make_environment(found)
    env.reset(seed=0)
    legal = {"f": np.array([[0, 1], [1, 0]])}
    verdict = Referee(env).rule(legal)
    assert not verdict.illegal
    np.testing.assert_array_equal(verdict.actions["f"], legal["f"])
    assert Referee(env).rule({"f": np.eye(2, dtype=int)}).illegal


def test_the_optimum_is_that_of_all_legal_actions(tmp_path):
    found = problem(tmp_path, TRANSPOSED, DIAGONAL, "n <= 1;")
    env = make_environment(found)
    returns = []
    for values in itertools.product(range(4), repeat=4):
        actions = {"a": np.reshape(values, (2, 2)), "f": np.array([[0, 1], [1, 0]]), "n": 1}
        env.reset(seed=0)
        if env.sampler.check_action_preconditions(actions, silent=True):
            returns.append(env.step(actions)[1])
    assert max(returns) == find_optimum(found, 20.0).optimum.value == 15.0


def test_a_planner_has_the_same_boxes(tmp_path):
    found = problem(tmp_path, TRANSPOSED, DIAGONAL, SMALLEST, kind="real")
    planner = build_planner(found, PRESETS["auto"](found.domain_name)).planner
    for compiled in (planner.compiled, planner.test_compiled):
        limits = {name: compiled.constraints.bounds[name][1] for name in "afn"}
        np.testing.assert_array_equal(limits["a"], [[1, 3], [1, 1]])
        np.testing.assert_array_equal(limits["f"], np.ones((2, 2)))
        assert limits["n"] == 1
