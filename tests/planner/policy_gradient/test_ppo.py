"""Learning from exact rollouts, where the best policy is known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import assert_same_bits
from helpers.toys import toy

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.policy_gradient.ppo import Learning, Pace, PolicyGradient

# a program of its own is compiled for them all
pytestmark = pytest.mark.long
KEY = jax.random.PRNGKey(1)
QUICK = Learning(rollouts=16, epochs=2, minibatches=2)


@pytest.fixture(scope="module")
def planner():
    # 3 for the best of three arms, of which one may be pulled, at each of 4 steps
    words = {"LIKELIHOOD": "0.75", "DISCOUNT": "1.0", "TERMINATION": "false", "MOST": "1"}
    problem = toy("lever", RULES="forall_{?a : arm} [pull(?a) => true];", **words)
    return build_planner(problem, auto_preset("lever").without_section("Search")).planner


@pytest.fixture(scope="module")
def gradient(planner):
    return PolicyGradient(planner, QUICK)


@pytest.fixture
def learner(planner, gradient):
    return gradient.begin(planner.plan.initializer(KEY, {}, None), KEY)


def learnt(gradient, learner, iterations: int):
    shown = []
    for number in range(iterations):
        pace = Pace(0.01, 0.01)
        learner, seen = gradient.iterate(learner, jax.random.fold_in(KEY, number), pace)
        shown.append(seen)
    return learner, shown


def test_the_best_action_is_learnt(planner, gradient, learner):
    learner, shown = learnt(gradient, learner, 60)
    # at first each of three arms and none is as likely: (1 - 2 + 3) / 4 x 0.75 x 4 steps
    assert float(shown[0].mean_return) == pytest.approx(1.5, abs=1.2)
    assert all(bool(seen.is_finite) for seen in shown)
    assert float(shown[0].entropy) == pytest.approx(np.log(4.0), rel=1e-4)
    assert float(np.mean([seen.mean_return for seen in shown[-5:]])) > 8.0
    assert float(shown[-1].entropy) < 0.5
    none = {"pulled": jnp.zeros(3, bool)}
    played = planner.legal_policy(KEY, learner.params, {}, 0, none, {})
    assert np.asarray(played["pull"]).tolist() == [False, False, True]


def test_the_same_keys_give_the_same_policy_and_the_plan_is_left_alone(gradient, learner):
    first, second = (learnt(gradient, learner, 3)[0] for _ in range(2))
    assert_same_bits(first.params, second.params)
    assert_same_bits(first.params["plan"], learner.params["plan"])
    assert np.any(first.params["own"]["pull"]["bias"] != learner.params["own"]["pull"]["bias"])


def test_what_is_not_finite_is_not_learnt(gradient, learner):
    after, shown = gradient.iterate(learner, KEY, Pace(np.inf, 0.0))
    assert not bool(shown.is_finite)
    assert_same_bits(after, learner)


def test_at_a_step_of_zero_the_policy_stays(gradient, learner):
    after, _ = gradient.iterate(learner, KEY, Pace(0.0, 0.0))
    assert_same_bits(after.params, learner.params)
    assert float(after.scale) > 0.0
