"""The rule in words, against equations, sizes and costs that were worked by hand."""

import json

import numpy as np
import pytest
from helpers.toys import FOLDER, problem_from

from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.policy.formula import FeedbackFormula
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.policy.rule.explanation import explain

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


def formula_of(problem, **shape):
    """A formula, and the parameters of the no-op."""
    arguments = {"topology": None, **shape}
    config = auto_preset("").with_values("Planner", method_kwargs=arguments)
    formula = FeedbackFormula(problem, config)
    return formula, formula.actions.feedback.initial(np.random.default_rng(0))


UNITS = {"state_scales": {"x": (2.0, 4.0)}, "units": {"push": 2.0}}


@pytest.fixture
def pushing():
    """push(i) = 0.5 - 0.5 (x(i) - 2), in units of 2 and with x in (x - 2) / 4."""
    formula, params = formula_of(problem_from(TEXT), cosines=1, **UNITS)
    names, weights = formula.actions.feedback.names("push"), params["shared"]["push"]
    weights[names.index("1")], weights[names.index("x")] = 0.25, -1.0
    return formula, params


def test_terms_are_in_the_domains_units_and_cost_what_they_are_worth(pushing):
    explained = explain(*pushing)
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


def test_other_features_and_each_objects_own(pushing):
    formula, params = pushing
    names = formula.actions.feedback.names("push")
    weights = np.zeros(len(names))
    weights[names.index("x^2")], weights[names.index("WEIGHT")] = 1.0, -0.5
    weights[names.index("cos(1 pi t / H)")] = 3.0
    own = {**params["own"]["push"], "gain on x": np.array([0.2, -0.4])}
    params = {"shared": params["shared"] | {"push": weights}, "own": params["own"] | {"push": own}}
    explanation = explain(formula, params, seconds=0.0)
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
    formula, params = formula_of(pushing[0].simulator.problem, cosines=0, pairs=4, **UNITS)
    gains = np.array([[0.0, 0.2], [-0.4, 0.0]])
    own = {**params["own"]["push"], "gains of pairs on x": gains}
    params = {**params, "own": {**params["own"], "push": own}}
    (term,) = explain(formula, params, seconds=0.0).equations[0].terms
    assert term.text == "+ a gain for each pair of objects on (x - 2) (from -0.2 to 0.1)"
    assert not term.is_shared


def test_a_hidden_layer_is_a_term_of_all_objects(pushing):
    formula, params = formula_of(pushing[0].simulator.problem, cosines=0, lifted=2)
    # one that says nothing is no term
    terms = explain(formula, params, seconds=0.0).equations[0].terms
    assert terms == ()
    layer = {**params["lifted"]["push"], "output": np.array([0.0, 1.0])}
    params = {**params, "lifted": {**params["lifted"], "push": layer}}
    (term,) = explain(formula, params, seconds=0.0).equations[0].terms
    assert term.text == "+ a net that sees the features of each object, the same for all objects"
    assert term.is_shared
    assert term.size > 0.0


def test_the_time_for_costs_is_kept(pushing):
    formula, params = pushing
    times = iter([0.0, 1.0, 2.0, 9.0, 9.0])
    found = explain(formula, params, seconds=3.0, clock=lambda: next(times))
    assert [term.cost for term in found.equations[0].terms] == [pytest.approx(-4.5), None]


def test_another_policy_has_no_rule():
    problem = problem_from(TEXT)
    config = auto_preset("").with_values("Planner", method="JaxStraightLinePlan", method_kwargs={})
    found = Policy(problem, config, {}, {}, 0).explain()
    assert found.equations == ()
    assert "no lifted rule" in str(found)


def test_a_term_without_which_the_environment_fails_has_no_cost():
    fragile = TEXT.replace("x(?i) + push(?i);", "x(?i) + push(?i) + Normal(0.0, push(?i));")
    formula, params = formula_of(problem_from(fragile))
    names, weights = formula.actions.feedback.names("push"), params["shared"]["push"]
    weights[names.index("1")], weights[names.index("WEIGHT")] = 0.1, 0.01
    explained = explain(formula, params)
    costs = [(term.cost, term.cost_error) for term in explained.equations[0].terms]
    assert costs[0] == (None, None)
    assert None not in costs[1]
    json.dumps(explained.to_json(), allow_nan=False)


def test_where_nothing_is_observed_terms_have_no_size():
    # the one step comes before the first observation
    problem = problem_from((FOLDER / "tiger.rddl").read_text(), horizon=1)
    formula, params = formula_of(problem, plan=False)
    params["shared"]["open-left"] += 1.0
    explained = explain(formula, params, seconds=0.0)
    terms = [term for equation in explained.equations for term in equation.terms]
    assert terms
    assert [term.size for term in terms] == [0.0] * len(terms)
