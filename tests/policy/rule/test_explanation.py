"""The rule in words, against equations, sizes and costs that were worked by hand."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import make_plan, make_planner
from helpers.toys import FOLDER, problem_from

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.policy.rule import explanation
from mdpo_rddl.policy.rule.explanation import explain, is_compiled

TEXT = """
domain pushing {
    types { item : object; };
    pvariables {
        WEIGHT(item) : { non-fluent, real, default = 1.0 };
        x(item) : { state-fluent, real, default = 1.0 };
        push(item) : { action-fluent, real, default = 0.0 };
        on : { action-fluent, bool, default = false };
    };
    cpfs { x'(?i) = x(?i) + push(?i); };
    reward = -(sum_{?i : item} [x(?i) * x(?i)]) - 100.0 * on;
    action-preconditions {
        forall_{?i : item} [push(?i) >= -10.0]; forall_{?i : item} [push(?i) <= 10.0];
    };
}
non-fluents nf {
    domain = pushing; objects { item : {a, b}; }; non-fluents { WEIGHT(b) = 2.0; };
}
instance one {
    domain = pushing; non-fluents = nf; init-state { x(b) = 3.0; };
    max-nondef-actions = pos-inf; horizon = 2; discount = 1.0;
}
"""


@pytest.fixture(scope="module")
def pushing():
    """push(i) = 0.5 - 0.5 (x(i) - 2), in units of 2 and with x in (x - 2) / 4."""
    problem = problem_from(TEXT)
    shape = FeedbackShape(topology=None, cosines=1, state_scales={"x": (2.0, 4.0)})
    planner = make_planner(MDPOPlanner, problem, FeedbackPlan(shape, {"push": 2.0}))
    params = planner.plan.initializer(jax.random.PRNGKey(0), {}, None)
    names = planner.feedback_plan.feedback.names("push")
    weights = np.zeros(len(names))
    weights[names.index("1")], weights[names.index("x")] = 0.25, -1.0
    params["shared"]["push"] = jnp.asarray(weights, params["shared"]["push"].dtype)
    return problem, planner, params


def test_terms_are_in_the_domains_units_and_cost_what_they_are_worth(pushing):
    problem, planner, params = pushing
    explained = explain(problem, planner, params)
    push, on = explained.equations
    assert (push.head, push.within) == ("push(?item) = 0", "clipped to [-10, 10]")
    assert [term.text for term in push.terms] == ["+ 0.5", "- 0.5 (x - 2)"]
    # x is 1 and 3, then 2 and 3
    assert push.terms[0].size == pytest.approx(0.5)
    assert push.terms[1].size == pytest.approx(np.sqrt((0.25 + 0.25 + 0.25) / 4))
    # squares: 10 and 13 with the rule, 8.5 without the constant, 14.5 without the gain
    assert [term.cost for term in push.terms] == pytest.approx([-4.5, 1.5])
    assert [term.cost_error for term in push.terms] == [0.0, 0.0]
    assert (on.head, on.terms) == ("on is true if 0 <", ())
    assert "- 0.5 (x - 2)    size 0.433, without it -1.5 (error 0)" in str(explained)
    assert is_compiled(planner)


def test_other_features_and_each_objects_own(pushing):
    problem, planner, params = pushing
    names = planner.feedback_plan.feedback.names("push")
    weights = np.zeros(len(names))
    weights[names.index("x^2")], weights[names.index("WEIGHT")] = 1.0, -0.5
    weights[names.index("cos(1 pi t / H)")] = 3.0
    own = {**params["own"]["push"], "gain on x": jnp.array([0.2, -0.4])}
    params = {"shared": params["shared"] | {"push": weights}, "own": params["own"] | {"push": own}}
    explanation = explain(problem, planner, params, seconds=0.0)
    terms = explanation.equations[0].terms
    assert {term.text for term in terms} == {
        "+ 0.125 ((x - 2)^2 - 16)",
        "- 2 (WEIGHT - 1.5)",
        "+ 6 cos(1 pi t / H)",
        "+ a gain of each object's own on (x - 2) (from -0.2 to 0.1)",
    }
    assert [term.size for term in terms] == sorted((term.size for term in terms), reverse=True)
    assert {term.cost for term in terms} == {None}
    assert [term.is_shared for term in terms].count(False) == 1


def test_gains_of_pairs_are_a_term_of_their_own(pushing):
    problem, _, _ = pushing
    shape = FeedbackShape(topology=None, cosines=0, state_scales={"x": (2.0, 4.0)}, pairs=4)
    planner = make_planner(MDPOPlanner, problem, FeedbackPlan(shape, {"push": 2.0}))
    params = planner.plan.initializer(jax.random.PRNGKey(0), {}, None)
    gains = jnp.array([[0.0, 0.2], [-0.4, 0.0]])
    own = {**params["own"]["push"], "gains of pairs on x": gains}
    params = {**params, "own": {**params["own"], "push": own}}
    (term,) = explain(problem, planner, params, seconds=0.0).equations[0].terms
    assert term.text == "+ a gain for each pair of objects on (x - 2) (from -0.2 to 0.1)"
    assert not term.is_shared


def test_a_hidden_layer_is_a_term_of_all_objects(pushing):
    problem, _, _ = pushing
    shape = FeedbackShape(topology=None, cosines=0, lifted=2)
    planner = make_planner(MDPOPlanner, problem, FeedbackPlan(shape))
    params = planner.plan.initializer(jax.random.PRNGKey(0), {}, None)
    # one that says nothing is no term
    terms = explain(problem, planner, params, seconds=0.0).equations[0].terms
    assert terms == ()
    layer = {**params["lifted"]["push"], "output": jnp.array([0.0, 1.0])}
    params = {**params, "lifted": {**params["lifted"], "push": layer}}
    (term,) = explain(problem, planner, params, seconds=0.0).equations[0].terms
    assert term.text == "+ a net that sees the features of each object, the same for all objects"
    assert term.is_shared
    assert term.size > 0.0


def test_the_time_for_costs_is_kept(pushing):
    problem, planner, params = pushing
    times = iter([0.0, 1.0, 2.0, 9.0, 9.0])
    found = explain(problem, planner, params, seconds=3.0, clock=lambda: next(times))
    assert [term.cost for term in found.equations[0].terms] == [pytest.approx(-4.5), None]


def test_another_policy_has_no_rule():
    problem = problem_from(TEXT)
    planner = make_planner(MDPOPlanner, problem, make_plan("slp"))
    found = explain(problem, planner, {})
    assert found.equations == ()
    assert "no lifted rule" in str(found)


def test_a_term_without_which_the_model_diverges_has_no_cost(pushing, monkeypatch):
    def play(key, params):
        bias = np.asarray(params["shared"]["push"])[0, 0]
        return np.array([[-1.0, -1.0 if bias else np.nan]])

    monkeypatch.setattr(explanation, "exact_returns", lambda planner, rollouts: play)
    push, _ = explain(*pushing).equations
    assert [(term.cost, term.cost_error) for term in push.terms] == [(None, None), (0.0, 0.0)]
    json.dumps(explain(*pushing).to_json(), allow_nan=False)


def test_where_nothing_is_observed_terms_have_no_size():
    # the one step comes before the first observation
    problem = problem_from((FOLDER / "tiger.rddl").read_text(), horizon=1)
    plan = FeedbackPlan(FeedbackShape(topology=None, plan=False))
    planner = make_planner(MDPOPlanner, problem, plan)
    params = planner.plan.initializer(jax.random.PRNGKey(0), {}, None)
    names = planner.feedback_plan.feedback.names("open-left")
    params["shared"]["open-left"] = jnp.ones(len(names))
    explained = explain(problem, planner, params, seconds=0.0)
    terms = [term for equation in explained.equations for term in equation.terms]
    assert terms
    assert [term.size for term in terms] == [0.0] * len(terms)
