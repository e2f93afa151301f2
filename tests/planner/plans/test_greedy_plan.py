"""The greedy policy of a value, on toys whose gains are known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.toys import FOLDER, problem_from, toy

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.fitting import greedy
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.plans.greedy_plan import GreedyPlan
from mdpo_rddl.planner.plans.opened import open_plan
from mdpo_rddl.problem.load import load_problem

KEY = jax.random.PRNGKey(3)
CONFIG = greedy(auto_preset("").without_section("Search"))
LEVER = {"LIKELIHOOD": "1.0", "DISCOUNT": "0.5", "TERMINATION": "false", "MOST": "pos-inf"}
FREE = "forall_{?a : arm} [pull(?a) => true];"
NOT_PULLED = {"pulled": jnp.zeros(3, bool)}


def lever(rules: str = FREE, **words: str):
    problem = toy("lever", **{**LEVER, **words, "RULES": rules})
    return build_planner(problem, CONFIG).planner


@pytest.fixture(scope="module")
def planner():
    return lever()


@pytest.fixture(scope="module")
def noop(planner):
    """Weights with which every value is zero."""
    return planner.plan.initializer(KEY, {}, None)


def gains_of(planner, weights, keys=KEY, samples=None):
    """Those of a state in which nothing was pulled, for one random key or many."""
    gains = jax.jit(
        jnp.vectorize(
            lambda key: planner.plan.gains(weights, key, NOT_PULLED, 0, samples),
            signature="(k)->(d)",
        )
    )
    return np.asarray(gains(keys))


def action(planner, weights, state=None, step=0):
    seen = NOT_PULLED if state is None else state
    played = planner.test_policy(KEY, weights, {}, step, seen, {})
    return {name: np.asarray(value).tolist() for name, value in played.items()}


def worth(weights, arms):
    """Weights of a value that is linear in which arms were pulled."""
    return weights | {"direct": jnp.array(arms, jnp.float32)}


def test_without_a_value_a_gain_is_the_reward(planner, noop):
    gains = gains_of(planner, noop)
    np.testing.assert_allclose(gains, [1.0, -2.0, 3.0])
    assert action(planner, noop) == {"pull": [True, False, True]}


def test_with_a_value_it_is_that_of_the_next_state_as_well(planner, noop):
    weights = worth(noop, [-4.0, 8.0, 0.0])
    gains = gains_of(planner, weights)
    np.testing.assert_allclose(gains, [1.0 - 0.5 * 4.0, -2.0 + 0.5 * 8.0, 3.0])
    assert action(planner, weights) == {"pull": [False, True, True]}
    # after the last step there is none
    assert action(planner, weights, step=3) == {"pull": [True, False, True]}


def test_the_value_reads_how_likely_a_bool_is():
    chance = lever(LIKELIHOOD="0.25")
    weights = worth(chance.plan.initializer(KEY, {}, None), [100.0, 0.0, 0.0])
    gains = gains_of(chance, weights, jax.random.split(KEY, 30))
    # the reward is that of the sample
    assert set(np.round(gains[:, 0] - 0.5 * 0.25 * 100.0, 3)) == {0.0, 1.0}


def test_gains_are_the_mean_of_the_samples(noop):
    chance = lever(LIKELIHOOD="0.5")
    keys = jax.random.split(KEY, 40)
    one, four = (gains_of(chance, noop, keys, samples)[:, 0] for samples in (None, 4))
    assert set(one) == {0.0, 1.0}
    assert set(four) >= {0.25, 0.5, 0.75}
    assert np.std(four) < 0.7 * np.std(one)


def test_the_best_changes_are_chosen_within_the_limits(noop):
    assert action(lever(MOST="1"), noop) == {"pull": [False, False, True]}
    one = "(sum_{?a : arm} [pull(?a)]) <= 1;"
    assert action(lever(one), noop) == {"pull": [False, False, True]}


def test_what_a_rule_forbids_is_not_played(noop):
    forbidden = "forall_{?a : arm} [(PAYS(?a) > 2.0) => ~pull(?a)];"
    assert action(lever(forbidden), noop) == {"pull": [True, False, False]}


def test_nothing_is_expected_after_the_end(noop):
    ending = lever(TERMINATION="exists_{?a : arm} [pulled(?a) ^ (PAYS(?a) > 2.0)]")
    weights = worth(noop, [0.0, 0.0, 1000.0])
    gains = gains_of(ending, weights)
    np.testing.assert_allclose(gains, [1.0, -2.0, 3.0])


def test_what_is_usual_is_lost_at_the_end(noop):
    ending = lever(TERMINATION="exists_{?a : arm} [pulled(?a) ^ (PAYS(?a) > 2.0)]")
    weights = noop | {"levels": np.array([8.0, 6.0, 4.0, 2.0], np.float32)}
    # half of the 6 that are usual from step 1 on
    np.testing.assert_allclose(gains_of(ending, weights), [1.0, -2.0, 3.0 - 3.0])
    assert action(ending, weights) == {"pull": [True, False, False]}
    # after the last step nothing is
    assert action(ending, weights, step=3) == {"pull": [True, False, True]}
    # what goes on has it whatever is done
    np.testing.assert_array_equal(gains_of(lever(), weights), gains_of(lever(), noop))


def test_nothing_is_compiled_to_see_what_changes_affect(caplog):
    plan = build_planner(load_problem("Tamarisk_MDP_ippc2014", "9"), CONFIG).planner.plan
    jax.clear_caches()
    with jax.log_compiles():
        assert plan.tried
        assert "XLA compilation" not in caplog.text
        jax.jit(jnp.cos)(1.0)
    assert "XLA compilation" in caplog.text  # it would have been seen


def test_it_says_that_its_actions_are_legal(planner):
    plan = planner.plan
    assert open_plan(plan) is plan
    assert planner.legal_policy is plan.test_policy
    assert plan.is_legal
    assert plan.guess_next_epoch({"direct": 1}) == {"direct": 1}


def test_it_needs_actions_of_few_values():
    with pytest.raises(InputError, match="GreedyPlan needs actions of few values each"):
        build_planner(load_problem("Reservoir_ippc2023", "1"), CONFIG)


def dials(largest="4", most="pos-inf"):
    words = {"LEAST": "0", "LARGEST": largest, "MOST": most}
    return build_planner(toy("dials", **words), CONFIG).planner


def turned(planner):
    noop = planner.plan.initializer(KEY, {}, None)
    return action(planner, noop, {"seen": jnp.array(1)})


@pytest.mark.parametrize(
    ("largest", "turns"),
    [
        ("4", [3, 0]),
        # what the first dial leaves is the second's
        ("2", [2, 1]),
    ],
)
def test_numbers_and_objects_are_decided_in_turn(largest, turns):
    planner = dials(largest)
    assert turned(planner) == {"turn": turns, "paint": 2, "ring": False}
    assert planner.plan.tried == 4 * int(largest)


@pytest.mark.parametrize(("most", "paint"), [("pos-inf", 2), ("1", 1)])
def test_what_is_no_number_does_not_hide_what_gains(most, paint):
    text = (FOLDER / "dials.rddl").read_text()
    for word, value in {"LEAST": "0", "LARGEST": "4", "MOST": most}.items():
        text = text.replace(word, value)
    # three turns and more have none
    text = text.replace("-abs[RIGHT", "sqrt[2.5 - (sum_{?d : dial} [turn(?d)])] - 9 * abs[RIGHT")
    planner = build_planner(problem_from(text), CONFIG).planner
    assert turned(planner) == {"turn": [2, 0], "paint": paint, "ring": False}


@pytest.mark.parametrize(
    ("most", "turns", "paint"),
    # of the single changes blue gains 5, as many turns as are right 3
    [("1", [0, 0], 2), ("2", [3, 0], 2)],
)
def test_few_of_them_may_leave_the_noop(most, turns, paint):
    assert turned(dials(most=most)) == {"turn": turns, "paint": paint, "ring": False}


@pytest.mark.parametrize(
    ("name", "instance", "samples", "in_rollouts"),
    [
        ("Traffic_MDP_ippc2014", "1", 1, 1),
        ("Elevators", "0", 64, 1),
        ("PowerGen_Discrete", "0", 64, 1),
        # actions say how likely something is
        ("Reservoir_Discrete", "0", 64, 4),
        ("Tamarisk_MDP_ippc2014", "1", 1, 1),
    ],
)
def test_more_is_sampled_where_not_all_that_is_drawn_is_read(name, instance, samples, in_rollouts):
    problem = load_problem(name, instance)
    plan = build_planner(problem, CONFIG).planner.plan
    assert (plan.samples, plan.rollout_samples) == (samples, in_rollouts)


GAMBLE = """
domain gamble {
    pvariables {
        gold : { state-fluent, int, default = 0 };
        wins : { interm-fluent, bool };
        dig : { action-fluent, bool, default = false };
    };
    cpfs { wins = Bernoulli(if (dig) then 0.3 else 0.0); gold' = gold; };
    reward = 2.0 * wins - dig;
}
non-fluents nf { domain = gamble; }
instance i {
    domain = gamble; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 20; discount = 1.0;
}
"""


def test_rollouts_do_not_go_by_one_chance_that_an_action_has():
    planner = build_planner(problem_from(GAMBLE), CONFIG).planner
    weights = planner.plan.initializer(KEY, {}, None)
    keys = jax.random.split(KEY, 400)
    state = {"gold": jnp.zeros((), int)}

    def digs(policy):
        return np.mean(jax.vmap(lambda key: policy(key, weights, {}, 0, state, {})["dig"])(keys))

    # it loses 0.4 on average; one sample would have it done at three of ten, and of four it takes
    # three that win
    assert digs(planner.plan.rollout_policy) == pytest.approx(0.084, abs=0.05)
    assert digs(planner.plan.test_policy) < 0.01


@pytest.mark.parametrize("samples", [0, -1, 1.5, True, "2"])
def test_there_must_be_a_sample(samples):
    with pytest.raises(ValueError, match="samples: must be a whole number"):
        GreedyPlan(samples=samples)


@pytest.mark.parametrize(
    ("name", "sets"),
    [
        ("AcademicAdvising_MDP_ippc2014", 1),
        ("GameOfLife_MDP_ippc2011", 1),
        ("SysAdmin_MDP_ippc2011", 1),
        ("Tamarisk_MDP_ippc2014", 2),
        ("Traffic_MDP_ippc2014", 1),
        ("Wildfire_MDP_ippc2014", 2),
    ],
)
def test_changes_without_a_common_effect_are_tried_together(name, sets):
    assert build_planner(load_problem(name, "9"), CONFIG).planner.plan.tried == sets


@pytest.mark.long
@pytest.mark.parametrize("name", ["SysAdmin_MDP_ippc2011", "Tamarisk_MDP_ippc2014"])
def test_tried_together_they_gain_what_each_gains_alone(name):
    planner = build_planner(load_problem(name, "2"), CONFIG).planner
    plan = planner.plan
    shapes = plan.initializer(KEY, {}, None)
    weights = {
        name: jax.random.normal(jax.random.fold_in(KEY, number), leaf.shape)
        for number, (name, leaf) in enumerate(shapes.items())
    }
    known = planner.test_compiled.init_values
    state = {
        name: jax.random.bernoulli(KEY, 0.5, np.shape(known[name]))
        for name in planner.rddl.state_fluents
    }
    assert plan.tried < plan.size
    together = plan.gains(weights, KEY, state, 3)
    plan.__dict__["_effects"] = None
    alone = plan.gains(weights, KEY, state, 3)
    assert np.ptp(alone) > 1.0
    np.testing.assert_allclose(together, alone, rtol=1e-4, atol=1e-3)
