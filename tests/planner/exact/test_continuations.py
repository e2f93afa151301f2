"""What a policy returns from any state at any step, if other actions come first."""

import jax
import numpy as np
import pytest
from helpers.levers import lever_policy
from helpers.problems import TINY_DOMAIN, TINY_INSTANCE
from helpers.toys import problem_from

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.exact.continuations import Continuations, Size
from mdpo_rddl.planner.start import unit_hyperparams
from mdpo_rddl.policy.policy import Compiled, Policy

NOWHERE = {"pulled": np.zeros(3, bool)}


# a height at which it is just high enough
EDGE = """
domain edge {
    pvariables {
        height : { state-fluent, real, default = 0.7 };
        rest : { action-fluent, bool, default = false };
    };
    cpfs { height' = height; };
    reward = if (height >= 0.7) then 1.0 else 0.0;
}
non-fluents nf { domain = edge; }
instance i { domain = edge; non-fluents = nf; horizon = 4; discount = 1.0; }
"""


def returns(policy, step, candidates, scenarios=3, state=NOWHERE, **options):
    candidates = np.asarray(candidates, np.float32)[:, np.newaxis]
    program = Continuations(policy.planner).compile(Size(len(candidates), scenarios), **options)
    given = policy.params, policy.policy_hyperparams, state, step, candidates
    return np.asarray(program(jax.random.PRNGKey(0), *given))


def test_the_candidate_comes_first_and_then_the_policy_to_the_horizon():
    # the policy pulls the first arm, which pays 1; three steps are left
    found = returns(lever_policy((1, 0, 0)), 1, [(1, 0, 0), (0, 0, 1), (0, 1, 0)])
    np.testing.assert_allclose(found, [[3.0] * 3, [5.0] * 3, [0.0] * 3])


def test_nothing_is_played_beyond_the_horizon():
    found = returns(lever_policy((1, 0, 0)), 3, [(1, 0, 0), (0, 0, 1)])
    np.testing.assert_allclose(found, [[1.0] * 3, [3.0] * 3])


def test_discounts_count_from_the_state_at_hand():
    found = returns(lever_policy((1, 0, 0), DISCOUNT="0.5"), 2, [(0, 0, 1)])
    np.testing.assert_allclose(found, [[3.5] * 3])


def test_no_reward_counts_after_the_end():
    policy = lever_policy((1, 0, 0), TERMINATION="exists_{?a : arm} [PAYS(?a) > 2 ^ pulled(?a)]")
    found = returns(policy, 0, [(1, 0, 0), (0, 0, 1)])
    np.testing.assert_allclose(found, [[4.0] * 3, [3.0] * 3])


def test_candidates_see_the_same_random_numbers():
    policy = lever_policy((1, 0, 1), LIKELIHOOD="0.5")
    found = returns(policy, 0, [(1, 0, 0), (1, 0, 0), (0, 0, 0)], scenarios=64)
    np.testing.assert_array_equal(found[0], found[1])
    assert len(set(found[0])) > 3
    # they differ by the first arm's first pull alone
    assert set(found[0] - found[2]) == {0.0, 1.0}
    assert found[0].mean() == pytest.approx(0.5 + 3 * 2.0, abs=0.8)


def test_a_return_that_hangs_on_rounding_is_not_certain():
    problem, config = problem_from(EDGE), auto_preset("edge").without_section("Search")
    planner = build_planner(problem, config).planner
    params = planner.plan.initializer(jax.random.PRNGKey(0), {}, None)
    policy = Policy(
        problem, config, params, unit_hyperparams(planner), seed=0, compiled=Compiled(planner)
    )
    place = 0, [(0.0,), (1.0,)], 64, {"height": np.array(0.7, np.float32)}
    assert np.all(returns(policy, *place) == 4.0)
    found = returns(policy, *place, is_rounded=True)
    assert set(found[0]) == {0.0, 4.0}
    # the first scenario is the state's own
    assert np.all(found[:, 0] == 4.0)
    np.testing.assert_array_equal(found[0], found[1])
    # beside the edge rounding makes no difference
    beside = *place[:3], {"height": np.array(0.70001, np.float32)}
    assert np.all(returns(policy, *beside, is_rounded=True) == 4.0)


def test_what_is_legal():
    policy = lever_policy(MOST="1")
    legality = Continuations(policy.planner).compile_legality()
    actions = np.array([(0, 0, 0), (0, 1, 0), (1, 0, 1)], np.float32)
    np.testing.assert_array_equal(legality(NOWHERE, actions), [True, True, False])
    rules = "forall_{?a : arm} [pull(?a) => pulled(?a)];"
    legality = Continuations(lever_policy(RULES=rules).planner).compile_legality()
    state = {"pulled": np.array([True, False, True])}
    np.testing.assert_array_equal(legality(state, actions), [True, False, True])


def returns_of_plan(policy, plan, state=NOWHERE):
    program = Continuations(policy.planner).compile(Size(1, 1))
    given = policy.params, policy.policy_hyperparams, state, 0, np.array([plan], np.float32)
    return float(program(jax.random.PRNGKey(0), *given)[0, 0])


def test_later_rows_change_the_policy_s_actions():
    # the policy pulls the first arm at the other steps, and where a row says nothing of it
    plan = [(1, 0, 0), (0, 0, 2), (1, 0, 0)]
    assert returns_of_plan(lever_policy((1, 0, 0)), plan) == 1.0 + (1.0 + 3.0) + 0.0 + 1.0


def test_a_later_row_that_is_illegal_is_not_played():
    policy = lever_policy((1, 0, 0), MOST="1")
    # two arms at once, then the third instead of the first
    assert returns_of_plan(policy, [(1, 0, 0), (2, 0, 2), (1, 0, 2)]) == 1.0 + 1.0 + 3.0 + 1.0


def test_later_additions_to_reals_that_are_illegal_are_not_played():
    limit = "action-preconditions { (sum_{?u : unit} [push(?u)]) <= 0.75;"
    domain = TINY_DOMAIN.replace("action-preconditions {", limit)
    instance = TINY_INSTANCE.replace("_HORIZON", "3").replace("_SPREAD", "0.0")
    problem, config = problem_from(domain + instance), auto_preset("t").without_section("Search")
    planner = build_planner(problem, config).planner
    params = planner.plan.initializer(jax.random.PRNGKey(0), {}, None)
    policy = Policy(
        problem, config, params, unit_hyperparams(planner), seed=0, compiled=Compiled(planner)
    )
    start = {"x": np.array([0.0, 0.0])}
    plan = [(0.25, 0.25), (0.375, 0.5)]
    assert returns_of_plan(policy, plan, start) == -2 * (0.25 + 0.0625 + 0.0625)
    plan = [(0.25, 0.25), (0.25, 0.25)]
    assert returns_of_plan(policy, plan, start) == -2 * (0.25 + 0.0625)
