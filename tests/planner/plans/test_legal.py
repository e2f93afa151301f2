"""Proposals made legal: the same action in compiled rollouts as in play."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.choices import (
    AHEAD,
    ALL_OR_STAY,
    CHEAP,
    EXACTLY_ONE,
    IS_FREE,
    SHARED,
    SQUARES,
    picks,
    pushes,
    takes,
)
from helpers.problems import make_plan, make_planner

from mdpo_rddl.noise import NoNoise
from mdpo_rddl.planner.exact.exact import compile_exact_returns
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.planner.plans.legal import LegalActions
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.legality import Referee
from mdpo_rddl.problem.limits import group_limits
from mdpo_rddl.problem.load import make_environment


def make(problem):
    plan = FeedbackPlan(FeedbackShape(topology=None, plan=True))
    return MDPOPlanner(problem.model, plan, pgpe=None, batch_size_train=1, batch_size_test=1)


def started(problem):
    env = make_environment(problem)
    env.reset(seed=0)
    return env


def legalised(planner, pick, free=(1, 1, 1), stay=0.0, gear=0):
    """What becomes of a proposal of the bools above 1/2."""
    legal = LegalActions(planner.test_compiled, group_limits(planner.rddl)[0])
    probabilities = {"pick": jnp.array(pick, float), "stay": jnp.array(stay)}
    proposal = {name: value > 0.5 for name, value in probabilities.items()}
    state = {"free": np.array(free, bool), "bag": np.zeros(1)}
    actions = legal({**proposal, "gear": jnp.array(gear)}, probabilities, state)
    return (
        np.asarray(actions["pick"]).astype(int).tolist(),
        bool(actions["stay"]),
        int(actions["gear"]),
    )


@pytest.mark.parametrize(
    ("rules", "pick", "free", "picked"),
    [
        (IS_FREE, [0.9, 0.9, 0.1], [1, 0, 1], [1, 0, 0]),
        # within the weighted sum, the most probable first
        (CHEAP, [0.7, 0.8, 0.9], [1, 1, 1], [0, 0, 1]),
        (CHEAP, [0.7, 0.9, 0.8], [1, 1, 1], [1, 1, 0]),
        # the limit chooses among those that the implication allows
        (IS_FREE + "(sum_{?i : item} [pick(?i)]) <= 1;", [0.7, 0.9, 0.8], [1, 0, 1], [0, 0, 1]),
        # the no-op is illegal: the most probable legal change of it
        (IS_FREE + EXACTLY_ONE, [0.2, 0.4, 0.3], [1, 0, 1], [0, 0, 1]),
        (IS_FREE + EXACTLY_ONE, [0.6, 0.9, 0.8], [1, 0, 1], [0, 0, 1]),
        # a legal proposal stays as it is
        (CHEAP + IS_FREE, [0.9, 0.9, 0.2], [1, 1, 1], [1, 1, 0]),
    ],
)
def test_a_legal_action_near_the_proposal(rules, pick, free, picked):
    assert legalised(make(picks(rules)), pick, free)[0] == picked


def test_all_bools_of_a_fluent_where_no_single_change_is_legal():
    planner = make(picks(ALL_OR_STAY + "~stay;"))
    assert legalised(planner, [0.9, 0.2, 0.2]) == ([1, 1, 1], False, 0)


def test_where_nothing_legal_is_found_the_proposal_stands():
    planner = make(picks("(sum_{?i : item} [PRICE(?i) * pick(?i)]) == 3;"))
    assert legalised(planner, [0.1, 0.2, 0.9])[0] == [0, 0, 1]


def test_whole_numbers_keep_their_box_and_count():
    rules = "gear >= -0.5; gear <= 2.5;"
    assert legalised(make(picks(rules)), [0.9, 0.9, 0.1], gear=3) == (
        [1, 1, 0],
        False,
        2,
    )
    assert legalised(make(picks(rules, "1")), [0.9, 0.8, 0.1], gear=2) == (
        [0, 0, 0],
        False,
        2,
    )


def test_each_whole_number_has_its_own_box():
    problem = takes("")
    legal, referee = LegalActions(make(problem).test_compiled, []), Referee(started(problem))
    for take in ([2, 5], [5, 5], [0, 6], [-1, 0], [0, 0]):
        expected = not referee.rule({"take": np.array(take)}).illegal
        assert bool(legal.is_legal({"take": jnp.array(take)}, {})) == expected


def test_a_repair_stays_in_the_box_of_each_whole_number():
    problem = takes("(sum_{?i : item} [take(?i)]) == 4;")
    # the first one has no more than two
    repaired = LegalActions(make(problem).test_compiled, [])({"take": jnp.array([5, 0])}, {}, {})
    assert repaired["take"].tolist() == [2, 2]
    assert not Referee(started(problem)).rule({"take": np.asarray(repaired["take"])}).illegal


@pytest.mark.parametrize(
    ("rules", "most", "proposed", "expected"),
    [
        # each real up to its own bound, or as proposed
        (AHEAD, "pos-inf", [1.0, 0.9], [0.2, 0.5]),
        (AHEAD, "pos-inf", [0.3, -0.7], [0.2, -0.7]),
        (AHEAD, "pos-inf", [-1.0, 0.25], [-1.0, 0.25]),
        # both go back as far for a common bound
        (SHARED, "pos-inf", [0.5, 0.4], [0.35, 0.25]),
        # of one that is not linear the larger change takes what it needs, the other what is left
        (SQUARES, "pos-inf", [0.5, 0.4], [0.5, 0.1]),
        # beside what counts as a change, no more than there may be
        (AHEAD, "1", [0.8, 0.9], [0.0, 0.5]),
    ],
)
def test_a_real_goes_as_far_as_is_legal(rules, most, proposed, expected):
    problem = pushes(rules, most)
    legal = LegalActions(make(problem).test_compiled, [])
    state, light = {"x": np.array([0.0, 0.3], np.float32)}, {"light": jnp.array(False)}
    off = {"light": jnp.array(0.0)}
    repaired = legal({"push": jnp.array(proposed), **light}, off, state)
    np.testing.assert_allclose(repaired["push"], expected, atol=1.0 / 128.0)
    assert legal.is_legal(repaired, state)


def test_a_bool_stays_what_it_is_beside_a_real_that_is_shortened():
    legal = LegalActions(make(pushes()).test_compiled, [])
    proposal = {"push": jnp.array([1.0, 0.1]), "light": jnp.array(True)}
    repaired = legal(proposal, {"light": jnp.array(0.6)}, {"x": np.zeros(2, np.float32)})
    assert bool(repaired["light"])
    assert repaired["push"][1] == proposal["push"][1]
    assert repaired["push"][0] == pytest.approx(0.2, abs=1.0 / 128.0)


def test_a_planner_without_noise_plays_the_bound():
    problem, weights = pushes(), {"light": 1.0}
    planner = make_planner(MDPOPlanner, problem, make_plan("slp"), noise=NoNoise())
    params = planner.plan.initializer(jax.random.PRNGKey(0), weights, None)
    params = {**params, "push": jnp.ones_like(params["push"])}
    state, _ = make_environment(problem).reset(seed=0)
    action = planner.get_action(jax.random.PRNGKey(1), params, 0, state, weights)
    np.testing.assert_allclose(action["push"], [0.2, 0.2], atol=1.0 / 128.0)


def test_nothing_is_computed_where_the_policy_is_legal_as_it_is():
    limit = "(sum_{?i : item} [pick(?i)]) <= 1;"
    compiled = make(picks(limit)).test_compiled
    assert not LegalActions(compiled, group_limits(compiled.rddl)[0]).is_needed


BOXED = IS_FREE + "gear >= 0; gear <= 1;"
COMBINED = IS_FREE + EXACTLY_ONE


@pytest.mark.parametrize(
    ("rules", "most"),
    [
        (BOXED, "2"),
        (CHEAP, "2"),
        (COMBINED, "pos-inf"),
        (ALL_OR_STAY, "pos-inf"),
        pytest.param(CHEAP, "pos-inf", marks=pytest.mark.long),
        pytest.param(COMBINED, "1", marks=pytest.mark.long),
        *(
            pytest.param(rules, most, marks=pytest.mark.slow)
            for rules, most in (
                *((BOXED, most) for most in ("pos-inf", "1")),
                (CHEAP, "1"),
                (COMBINED, "2"),
                *((ALL_OR_STAY, most) for most in ("1", "2")),
            )
        ),
    ],
)
def test_judged_as_played(rules, most):
    loaded = picks(rules, most)
    planner = make(loaded)
    random, count = np.random.default_rng(0), 6
    params = planner.plan.initializer(jax.random.PRNGKey(0), {}, None)
    policies = jax.tree.map(
        lambda leaf: random.normal(size=(count, *leaf.shape)).astype(np.float32), params
    )
    returns = np.asarray(compile_exact_returns(planner, 1)(jax.random.PRNGKey(0), policies))[:, 0]
    env = make_environment(loaded)
    for number in range(count):
        one = jax.tree.map(lambda leaf, n=number: leaf[n], policies)
        played = evaluate(env, playable(planner, one, {}, 0), 1, 0)
        assert played.illegal_actions == 0
        assert played.mean == pytest.approx(returns[number], abs=1e-4)
