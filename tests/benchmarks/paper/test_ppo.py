"""PPO's pieces: the exact model step by step, the actor's law, and that it learns."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import tiny_files
from scipy import stats

pytest.importorskip("rejax", reason="PPO needs the extra 'paper'")

from benchmarks.paper.exact_steps import ExactSteps, compile_exact_steps
from benchmarks.paper.gymnax_problem import GymnaxProblem
from benchmarks.paper.methods import method_config
from benchmarks.paper.ppo_learner import GaussianActor, first_state, make_learner
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.exact.returns import compile_returns
from mdpo_rddl.planner.start import initial_parameters
from mdpo_rddl.problem.load import load_problem

KEY = jax.random.PRNGKey(5)


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    """Two units to move, without chance: a policy has one return."""
    problem = load_problem(*tiny_files(tmp_path_factory.mktemp("tiny")))
    return build_planner(problem, method_config("tiny", "deterministic", 2)).planner


@pytest.fixture(scope="module")
def steps(planner) -> ExactSteps:
    return compile_exact_steps(planner)


def test_the_steps_of_a_policy_add_up_to_its_return(planner, steps):
    # a net without biases does nothing where all is zero
    params = jax.tree.map(lambda leaf: leaf + 0.1, initial_parameters(planner, KEY))
    expected = compile_returns(planner)(jax.random.split(KEY, 2), params)[:, 0]
    for seed in range(2):
        net = jax.tree.map(lambda leaf, seed=seed: leaf[seed], params)
        fluents, total = steps.start, 0.0
        for _ in range(steps.horizon):
            raw = steps.raw_action(net, steps.observe(fluents))
            fluents, reward = steps.step(KEY, fluents, jnp.clip(raw, steps.lower, steps.upper))
            total += float(reward)
        assert total == pytest.approx(float(expected[seed]), rel=1e-5)
    assert expected[0] != expected[1]


def test_raw_actions_are_those_before_the_box(planner, steps):
    net = jax.tree.map(lambda leaf: 100.0 * leaf[0], initial_parameters(planner, KEY))
    raw = steps.raw_action(net, jnp.ones(steps.state_size))
    assert np.any(np.abs(raw) > 1.0)
    assert (steps.lower.tolist(), steps.upper.tolist()) == ([-1.0, -1.0], [1.0, 1.0])


def test_the_environment_ends_at_the_horizon_and_begins_anew(steps):
    env = GymnaxProblem(steps)
    start, state = env.reset(KEY)
    done = []
    for _ in range(2 * steps.horizon):
        observation, state, _, is_done, _ = env.step(KEY, state, jnp.array([0.5, -0.5]))
        done.append(bool(is_done))
    assert done == 2 * [*(steps.horizon - 1) * [False], True]
    np.testing.assert_array_equal(observation, start)


def test_the_actors_densities_are_the_normal_laws():
    actor = GaussianActor(lambda params, state: params * state, 0.0, (2,))
    assert actor.init(KEY, KEY, KEY)["log_std"].tolist() == [0.0, 0.0]
    params = {"net": jnp.array(2.0), "log_std": jnp.log(jnp.array([0.5, 3.0]))}
    states = jnp.array([[1.0, -1.0], [0.0, 2.0]])
    actions, log_prob = actor.apply(params, states, KEY, method="action_log_prob")
    law = stats.norm(2.0 * np.asarray(states), [0.5, 3.0])
    np.testing.assert_allclose(log_prob, law.logpdf(actions).sum(axis=1), rtol=1e-5)
    again, entropy = actor.apply(params, states, actions, method="log_prob_entropy")
    np.testing.assert_allclose(again, log_prob, rtol=1e-5)
    np.testing.assert_allclose(entropy, law.entropy().sum(axis=1), rtol=1e-5)


def test_the_learner_starts_from_the_net_that_it_is_given(planner, steps):
    nets = initial_parameters(planner, KEY)
    other, net = (jax.tree.map(lambda leaf, i=i: leaf[i], nets) for i in range(2))
    learner = make_learner(steps, other, (4,), 3, learning_rate=0.0)
    state = first_state(learner, KEY, net)
    jax.tree.map(np.testing.assert_array_equal, state.actor_ts.params["net"], net)
    after = learner.train_iteration(state)
    # a step of size 0 after each of 3 epochs
    assert after.actor_ts.step == after.critic_ts.step == 3
    jax.tree.map(np.testing.assert_array_equal, after.actor_ts.params, state.actor_ts.params)


def test_the_learner_reaches_the_goal_when_it_has_rollouts_enough(planner, steps):
    net = jax.tree.map(lambda leaf: leaf[0], initial_parameters(planner, KEY))
    learner = make_learner(steps, net, (12, 12), 10, num_envs=32, learning_rate=3e-3)
    train = jax.jit(lambda s: jax.lax.fori_loop(0, 100, lambda _, s: learner.train_iteration(s), s))
    trained = train(first_state(learner, KEY, net)).actor_ts.params["net"]
    policies = jax.tree.map(lambda *leaves: jnp.stack(leaves), net, trained)
    keys = jnp.stack([KEY, KEY])
    before, after = compile_returns(planner)(keys, policies)[:, 0]
    assert before == -2.0  # stays where it starts, 0.5 from the goal for 4 steps, two units
    assert -0.6 < after <= -0.5  # is there after one step
