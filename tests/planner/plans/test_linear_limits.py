"""Numbers projected onto what linear preconditions leave them."""

import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.orders import BUDGETS, STAFF, orders

from mdpo_rddl.planner.exact.exact import compile_exact_returns
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.planner.plans.legal import LegalActions
from mdpo_rddl.planner.plans.linear_limits import LinearLimits
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.legality import Referee
from mdpo_rddl.problem.load import load_problem, make_environment


@functools.cache
def planner_of(rules):
    problem = orders(rules)
    plan = FeedbackPlan(FeedbackShape(topology=None, plan=True))
    return problem, MDPOPlanner(
        problem.model, plan, pgpe=None, batch_size_train=1, batch_size_test=1
    )


@functools.cache
def limits_of(rules):
    problem, planner = planner_of(rules)
    limits = LinearLimits(planner.test_compiled, tuple(range(len(problem.model.preconditions))))
    return jax.jit(limits.__call__)


def shared(rules, buy=((0, 0), (0, 0)), hire=(0, 0), close=False, **state):
    """What becomes of a proposal."""
    compiled = planner_of(rules)[1].test_compiled
    fluents = compiled.split_fluent_nonfluent(compiled.init_values)[0]
    given = {name: np.asarray(value, fluents[name].dtype) for name, value in state.items()}
    proposal = {
        "buy": jnp.array(buy, float),
        "hire": jnp.array(hire),
        "close": jnp.array(close),
    }
    actions = limits_of(rules)(proposal, {**fluents, **given})
    return {name: np.asarray(value) for name, value in actions.items()}


def test_reals_go_to_the_nearest_point_of_each_budget():
    taken = shared(BUDGETS, [[4.0, 4.0], [2.0, 1.0]])
    # back by multiples of the prices, 1 and 2
    np.testing.assert_allclose(taken["buy"], [[2.8, 1.6], [2.0, 1.0]], atol=1e-3)
    # what keeps its budget is the same to the last bit
    assert taken["buy"][1].tolist() == [2.0, 1.0]


def test_a_small_proposal_gives_way_to_a_large_one():
    taken = shared(BUDGETS, [[9.0, 0.5], [0.0, 5.0]])
    np.testing.assert_allclose(taken["buy"], [[6.0, 0.0], [0.0, 3.0]], atol=1e-3)


def projected(buy, cash, prices):
    """The nearest point of a budget without debts, by its conditions of optimality."""
    breaks = np.sort(np.append(buy / prices, 0.0))
    spent = [np.maximum(buy - each * prices, 0.0) @ prices for each in breaks]
    return np.maximum(buy - np.interp(cash, spent[::-1], breaks[::-1]) * prices, 0.0)


def test_it_is_the_euclidean_projection_and_within_the_budget_in_64_bit():
    prices, cash = np.array([1.0, 2.0]), np.array([0.1, 7.3], np.float32).astype(float)
    for buy in np.random.default_rng(0).uniform(0.0, 9.0, (40, 2, 2)):
        taken = shared(BUDGETS, buy, cash=cash)["buy"].astype(float)
        assert np.all(taken @ prices <= cash)
        expected = [projected(each, most, prices) for each, most in zip(buy, cash, strict=True)]
        np.testing.assert_allclose(taken, expected, atol=1e-3)


@pytest.mark.parametrize(
    ("rule", "hire", "total"),
    [
        (STAFF, (8, 8), 3),
        (STAFF, (5, 1), 3),
        (STAFF, (2, 1), 3),
        (STAFF, (1, 1), 2),
        (STAFF.replace("<= 3", "< 3"), (8, 8), 2),
        # the other way round, and of unlike weights
        ("3.0 >= (sum_{?s : shop} [hire(?s)]);", (4, 4), 3),
        ("2 * (sum_{?s : shop} [hire(?s)]) <= 7;", (4, 4), 3),
        ("(sum_{?s : shop} [hire(?s)]) == 3;", (8, 6), 3),
    ],
)
def test_integers_share_all_there_is(rule, hire, total):
    taken = shared(rule, hire=hire)["hire"]
    assert taken.dtype.kind == "i"
    assert taken.sum() == total
    assert np.all((taken >= 0) & (taken <= np.array(hire)))
    # no less of what was more
    assert (taken[0] - taken[1]) * (hire[0] - hire[1]) >= 0


@pytest.mark.parametrize(
    ("rule", "hire", "expected"),
    [
        # as far as the box of each allows
        ("(sum_{?s : shop} [hire(?s)]) >= 9;", (3, 1), (6, 3)),
        ("(sum_{?s : shop} [hire(?s)]) >= 14;", (3, 1), (8, 6)),
        ("(sum_{?s : shop} [hire(?s)]) > 3;", (2, 1), (3, 1)),
        ("(sum_{?s : shop} [hire(?s)]) == 7;", (3, 1), (4, 3)),
        ("forall_{?s : shop} [hire(?s) == 2];", (3, 0), (2, 2)),
        # no box holds that
        ("(sum_{?s : shop} [hire(?s)]) >= 17;", (3, 1), (3, 1)),
    ],
)
def test_what_has_to_be_covered_is_where_the_boxes_allow_it(rule, hire, expected):
    taken = shared(rule, hire=hire)["hire"]
    assert abs(taken - np.array(expected)).max() <= 1
    assert taken.sum() == sum(expected)


def test_reals_cover_a_need_of_the_state():
    rule = "forall_{?s : shop} [(sum_{?i : item} [buy(?s, ?i)]) >= cash(?s)];"
    taken = shared(rule, [[1.0, 2.0], [8.5, 0.0]], cash=(6.0, 15.0))["buy"]
    np.testing.assert_allclose(taken, [[2.5, 3.5], [9.0, 6.0]], atol=1e-3)
    assert np.all(taken.astype(float).sum(axis=1) >= [6.0, 15.0])


OWN_BOUNDS = "forall_{?s : shop, ?i : item} [buy(?s, ?i) <= cash(?s)];"


@pytest.mark.parametrize("cash", [0.0, 1e-7, 0.3, 3.3, 8.9999999])
def test_a_number_keeps_a_bound_that_is_a_fluent(cash):
    taken = shared(OWN_BOUNDS, [[9.0, 0.2], [4.0, 0.0]], cash=(cash, 5.0))["buy"]
    expected = [[cash, min(cash, 0.2)], [4.0, 0.0]]
    np.testing.assert_allclose(taken, expected, atol=2e-5)
    assert np.all(taken[0].astype(float) <= float(np.float32(cash)))
    assert taken.min() >= 0.0


def test_a_need_is_covered_within_such_bounds():
    need = "forall_{?s : shop} [(sum_{?i : item} [buy(?s, ?i)]) >= 5];"
    # whichever comes first
    for rule in (OWN_BOUNDS + need, need + OWN_BOUNDS):
        taken = shared(rule, [[9.0, 0.0], [1.0, 0.5]], cash=(3.0, 4.0))["buy"]
        np.testing.assert_allclose(taken, [[3.0, 2.0], [2.75, 2.25]], atol=1e-4)
        assert np.all(taken.astype(float).sum(axis=1) >= 5.0)


@pytest.mark.parametrize("factor", ["cash(?s)", "count(?s)", "WEIGHT(kind(?s))"])
def test_coefficients_may_be_fluents(factor):
    rule = f"forall_{{?s : shop}} [{factor} * (sum_{{?i : item}} [buy(?s, ?i)]) <= 12.0];"
    state = {"cash": [2.0, 3.0], "count": [2, 3], "kind": [0, 1]}
    taken = shared(rule, [[4.0, 2.0], [4.0, 2.0]], **state)["buy"]
    np.testing.assert_allclose(taken, [[4.0, 2.0], [3.0, 1.0]], atol=1e-3)


def test_reals_and_integers_share_one_budget():
    rule = "(sum_{?s : shop, ?i : item} [buy(?s, ?i)]) + (sum_{?s : shop} [hire(?s)]) <= 8;"
    taken = shared(rule, [[4.0, 4.0], [0.0, 0.0]], (4, 4))
    total = taken["buy"].sum() + taken["hire"].sum()
    assert 6.9 < total <= 8.0
    assert taken["hire"].min() > 0


def test_numbers_give_way_to_bools():
    rule = "(sum_{?s : shop, ?i : item} [buy(?s, ?i)]) + 4 * close <= 8;"
    buy = [[4.0, 4.0], [0.0, 0.0]]
    assert shared(rule, buy)["buy"].tolist() == buy
    taken = shared(rule, buy, close=True)
    np.testing.assert_allclose(taken["buy"], np.array(buy) / 2.0, atol=1e-3)
    assert taken["close"]


def test_where_the_no_op_breaks_it_as_well_the_proposal_stands():
    buy = [[4.0, 4.0], [2.0, 1.0]]
    assert shared(BUDGETS, buy, cash=(-1.0, 6.0))["buy"].tolist() == buy


@pytest.mark.parametrize(
    "rule",
    [
        "forall_{?s : shop} [(sum_{?i : item} [buy(?s, ?i)]) / cash(?s) <= 1.0];",
        "forall_{?s : shop} [(sum_{?i : item} [buy(?s, ?i)]) <= sqrt[-1.0 - cash(?s)]];",
        "forall_{?s : shop, ?i : item} [buy(?s, ?i) / cash(?s) <= 1.0];",
    ],
)
def test_what_is_no_number_leaves_the_proposal(rule):
    buy = [[4.0, 4.0], [0.0, 1.0]]
    assert shared(rule, buy, cash=(0.0, 0.0))["buy"].tolist() == buy


@pytest.mark.parametrize(
    "rule",
    [
        "forall_{?s : shop} [(prod_{?i : item} [buy(?s, ?i)]) <= cash(?s)];",
        "(sum_{?s : shop, ?i : item} [pow[buy(?s, ?i), 2]]) <= 3;",
        "forall_{?s : shop} [cash(?s) >= -100];",
    ],
)
def test_what_is_not_linear_is_left_to_the_search(rule):
    problem, planner = planner_of(rule)
    rules = len(problem.model.preconditions) - 1
    assert not LinearLimits(planner.test_compiled, (rules,)).is_needed


ALL = "(sum_{?s : shop, ?i : item} [buy(?s, ?i)])"


@pytest.mark.parametrize(
    ("rules", "buy", "expected"),
    [
        # each goes by as much, down to 0
        (f"{ALL} == 1.0;", ((0, 0), (0, 0)), ((0.25, 0.25), (0.25, 0.25))),
        (f"{ALL} == 1.0;", ((3, 2.5), (0, 0)), ((0.75, 0.25), (0, 0))),
        (f"{ALL} == 1.0;", ((1, 0), (0, 0)), ((1, 0), (0, 0))),
        # in 32 bit nothing is left of 1 next to these
        (f"{ALL} == 1.0;", ((8e7, 0), (0, 0)), ((1, 0), (0, 0))),
        # between two bounds
        (f"{ALL} <= 1.0001; {ALL} >= 0.9999;", ((1, 1), (0, 0)), ((0.5, 0.5), (0, 0))),
        (f"abs[{ALL} - 1.0] <= 0.0001;", ((1, 1), (0, 0)), ((0.5, 0.5), (0, 0))),
        # cash is 6 for each shop
        (
            "forall_{?s : shop} [(sum_{?i : item} [buy(?s, ?i)]) == cash(?s)];",
            ((4, 4), (0, 2)),
            ((3, 3), (2, 4)),
        ),
        # with numbers in common
        (
            "forall_{?s : shop} [(sum_{?i : item} [buy(?s, ?i)]) == cash(?s)];"
            "forall_{?i : item} [(sum_{?s : shop} [buy(?s, ?i)]) == 6];",
            ((4, 4), (0, 4)),
            ((4, 2), (2, 4)),
        ),
        ("is-open => " + f"({ALL} == 1.0);", ((2, 0), (0, 0)), ((1, 0), (0, 0))),
        ("~is-open | " + f"({ALL} == 1.0);", ((2, 0), (0, 0)), ((1, 0), (0, 0))),
        (
            f"if (is-open) then ({ALL} == 1.0) else ({ALL} == 0.0);",
            ((2, 0), (0, 0)),
            ((1, 0), (0, 0)),
        ),
        (f"~is-open => ({ALL} == 1.0);", ((2, 0), (0, 0)), ((2, 0), (0, 0))),
    ],
)
def test_equal_reals_are_equal_but_for_rounding(rules, buy, expected):
    played = shared(rules, buy)
    assert played["buy"] == pytest.approx(np.array(expected, float), abs=2e-4)
    planner = planner_of(rules)[1]
    legal = LegalActions(planner.test_compiled, [])
    assert legal.is_legal({name: jnp.asarray(value) for name, value in played.items()}, {})
    # rounding is forgiven, and nothing more
    moved = {**played, "buy": played["buy"] + np.float32(0.01)}
    assert bool(legal.is_legal(moved, {})) == rules.startswith("~is-open =>")


def test_where_a_guard_holds_integers_share_too():
    rule = "is-open => (sum_{?s : shop} [hire(?s)]) <= 3;"
    assert shared(rule, hire=(4, 1))["hire"].tolist() == [3, 0]
    assert shared(rule.replace("is-open", "~is-open"), hire=(4, 1))["hire"].tolist() == [4, 1]


def test_a_policy_plays_them_as_its_rollouts_do():
    problem, planner = planner_of(BUDGETS + STAFF)
    legal = LegalActions(planner.test_compiled, [])
    draws = np.random.default_rng(1)
    env = make_environment(problem)
    env.reset(seed=0)
    referee = Referee(env)
    for _ in range(20):
        proposal = {
            "buy": jnp.array(draws.uniform(0, 9, (2, 2)), jnp.float32),
            "hire": jnp.array(draws.integers(0, 9, 2)),
            "close": jnp.array(False),
        }
        actions = {k: np.asarray(v) for k, v in legal(proposal, {"close": 0.0}, {}).items()}
        assert not referee.rule(actions).illegal


def test_units_that_are_switched_serve_a_load():
    folder = Path(__file__).parents[3] / "examples" / "units"
    problem = load_problem(str(folder / "units.rddl"), str(folder / "four.rddl"))
    plan = FeedbackPlan(FeedbackShape(topology=None, plan=True))
    planner = MDPOPlanner(problem.model, plan, pgpe=None, batch_size_train=1, batch_size_test=1)
    legal = jax.jit(LegalActions(planner.test_compiled, []).__call__)
    env = make_environment(problem)
    env.reset(seed=0)
    referee, draws = Referee(env), np.random.default_rng(2)
    for _ in range(20):
        likely, power = draws.random(4), draws.uniform(0.0, 9.0, 4)
        proposal = {"on": likely > 0.5, "power": jnp.asarray(power, jnp.float32)}
        played = {name: np.asarray(v) for name, v in legal(proposal, {"on": likely}, {}).items()}
        assert not referee.rule(played).illegal
        assert played["on"].tolist() == (likely > 0.5).tolist()
        # each within its bounds, and no further back than the load, of 8, asks for
        within = np.where(likely > 0.5, np.clip(power, 1.0, [5, 5, 5, 8]), 0.0)
        assert played["power"].sum() == pytest.approx(min(8.0, within.sum()), abs=1e-3)


def test_returns_of_rollouts_are_those_of_play():
    problem, planner = planner_of(BUDGETS + STAFF)
    plan = planner.feedback_plan
    params = jax.tree.map(lambda leaf: np.asarray(leaf) + np.float32(0.7), plan.noop(0))
    one = jax.tree.map(lambda leaf: leaf[np.newaxis], params)
    returns = np.asarray(compile_exact_returns(planner, 1)(jax.random.PRNGKey(0), one))[0]
    played = evaluate(make_environment(problem), playable(planner, params, {}, 0), 1, seed=0)
    np.testing.assert_allclose(returns, played.returns, rtol=1e-4)
    assert played.returns[0] > 1.0
