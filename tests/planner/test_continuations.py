"""What a policy returns from any state at any step, if other actions come first."""

import jax
import numpy as np
import pytest
from helpers.levers import lever_policy

from mdpo_rddl.planner.continuations import Continuations, Size

NOWHERE = {"pulled": np.zeros(3, bool)}


def returns(policy, step, candidates, scenarios=3, state=NOWHERE):
    candidates = np.asarray(candidates, np.float32)[:, np.newaxis]
    program = Continuations(policy.planner).compile(Size(len(candidates), scenarios))
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


def test_what_is_legal():
    policy = lever_policy(MOST="1")
    legality = Continuations(policy.planner).compile_legality()
    actions = np.array([(0, 0, 0), (0, 1, 0), (1, 0, 1)], np.float32)
    np.testing.assert_array_equal(legality(NOWHERE, actions), [True, True, False])
    rules = "forall_{?a : arm} [pull(?a) => pulled(?a)];"
    legality = Continuations(lever_policy(RULES=rules).planner).compile_legality()
    state = {"pulled": np.array([True, False, True])}
    np.testing.assert_array_equal(legality(state, actions), [True, False, True])


def returns_of_plan(policy, plan):
    program = Continuations(policy.planner).compile(Size(1, 1))
    given = policy.params, policy.policy_hyperparams, NOWHERE, 0, np.array([plan], np.float32)
    return float(program(jax.random.PRNGKey(0), *given)[0, 0])


def test_later_rows_change_the_policy_s_actions():
    # the policy pulls the first arm at the other steps, and where a row says nothing of it
    plan = [(1, 0, 0), (0, 0, 2), (1, 0, 0)]
    assert returns_of_plan(lever_policy((1, 0, 0)), plan) == 1.0 + (1.0 + 3.0) + 0.0 + 1.0


def test_a_later_row_that_is_illegal_is_not_played():
    policy = lever_policy((1, 0, 0), MOST="1")
    # two arms at once, then the third instead of the first
    assert returns_of_plan(policy, [(1, 0, 0), (2, 0, 2), (1, 0, 2)]) == 1.0 + 1.0 + 3.0 + 1.0
