"""Counts in the exact model: their laws, their errors, and whose random numbers they are."""

import jax
import numpy as np
import pytest
from helpers.lakes import preset
from helpers.toys import problem_from

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.fitting import without_scales
from mdpo_rddl.planner.config.jaxplan_configs import jaxplan_config
from mdpo_rddl.planner.exact.exact import compile_exact_returns
from mdpo_rddl.planner.model.exact_model import ExactModel
from mdpo_rddl.planner.model.repairs import repaired
from mdpo_rddl.planner.upstream import INVALID_PARAMETERS, JaxRDDLCompiler
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment

SHOP = """domain shop {
    types { item : object; };
    pvariables {
        RATE(item) : { non-fluent, real, default = 2.0 };
        stock(item) : { state-fluent, int, default = 4 };
        sold(item) : { interm-fluent, int };
        order(item) : { action-fluent, int, default = 0 };
    };
    cpfs {
        sold(?i) = min[stock(?i), LAW];
        stock'(?i) = stock(?i) - sold(?i) + order(?i);
    };
    reward = sum_{?i : item} [sold(?i) - 0.1 * stock(?i) - 0.3 * order(?i)];
    action-preconditions { forall_{?i : item} [order(?i) >= 0 ^ order(?i) <= 5]; };
}
non-fluents n { domain = shop; objects { item : {i1, i2}; }; non-fluents { RATE(i1) = 0.7; }; }
instance i {
    domain = shop; non-fluents = n; max-nondef-actions = pos-inf; horizon = 8; discount = 1.0;
}
"""
LAWS = {"Poisson": "Poisson(RATE(?i))", "Binomial": "Binomial(stock(?i) + 2, 0.3)"}


def planner_of(law: str):
    problem = problem_from(SHOP.replace("LAW", law))
    return problem, build_planner(problem, without_scales(preset(1.0))).planner


@pytest.mark.parametrize("law", LAWS)
def test_it_returns_what_the_environment_does(law):
    problem, planner = planner_of(LAWS[law])
    assert isinstance(planner.test_compiled, ExactModel)
    params = planner.feedback_plan.noop(0)
    one = jax.tree.map(lambda leaf: np.asarray(leaf)[np.newaxis], params)
    returns = np.asarray(compile_exact_returns(planner, 1000)(jax.random.PRNGKey(0), one))[0]
    played = evaluate(make_environment(problem), lambda step, state: {}, 200, seed=0).returns
    error = np.hypot(np.std(returns) / np.sqrt(1000), np.std(played) / np.sqrt(200))
    assert abs(np.mean(returns) - np.mean(played)) < 4.0 * error
    assert 0.8 < np.std(returns) / np.std(played) < 1.25


@pytest.mark.parametrize(
    ("law", "stock", "is_law"),
    [
        ("Poisson(stock(?i) - 2.0)", 2, True),
        ("Poisson(stock(?i) - 2.0)", 1, False),
        ("Binomial(3, stock(?i) * 0.25)", 4, True),
        ("Binomial(3, stock(?i) * 0.25)", 5, False),
        ("Binomial(stock(?i) - 2, 0.5)", 1, False),
    ],
)
def test_what_is_no_law_is_an_error(law, stock, is_law):
    _, planner = planner_of(law)
    model = planner.test_compiled
    transition = model.compile_transition(check_constraints=True, cache_path_info=False)
    fluents, nonfluents = model.split_fluent_nonfluent(model.init_values)
    fluents = {**fluents, "stock": np.array([4, stock])}
    given = {"order": np.zeros(2, int)}, fluents, nonfluents, model.model_aux["params"]
    _, log, _ = transition(jax.random.PRNGKey(0), *given)
    assert (int(log["error"]) & INVALID_PARAMETERS == 0) == is_law


def test_jaxplan_s_own_plans_have_jaxplan_s_random_numbers():
    problem = problem_from(SHOP.replace("LAW", LAWS["Poisson"]))
    config = jaxplan_config("default", "slp")
    assert type(build_planner(problem, config).planner.test_compiled) is repaired(JaxRDDLCompiler)
