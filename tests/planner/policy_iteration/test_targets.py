"""Lambda-returns, worked by hand."""

import jax.numpy as jnp
import numpy as np

from mdpo_rddl.planner.policy_iteration.targets import Decay, lambda_returns

REWARDS = jnp.array([[1.0, 2.0, 4.0]])
VALUES = jnp.array([[3.0, 5.0, 8.0]])
ALIVE = jnp.ones((1, 3))
ON_POLICY = jnp.zeros((1, 3), bool)


def test_between_the_value_and_the_rollout():
    found = lambda_returns(REWARDS, VALUES, ALIVE, ON_POLICY, Decay(0.5, 0.0))
    np.testing.assert_allclose(found, [[1.0 + 0.5 * 5.0, 2.0 + 0.5 * 8.0, 4.0]])
    found = lambda_returns(REWARDS, VALUES, ALIVE, ON_POLICY, Decay(0.5, 1.0))
    np.testing.assert_allclose(found, [[1.0 + 0.5 * 4.0, 2.0 + 0.5 * 4.0, 4.0]])
    second = 2.0 + 0.5 * (0.75 * 8.0 + 0.25 * 4.0)
    first = 1.0 + 0.5 * (0.75 * 5.0 + 0.25 * second)
    found = lambda_returns(REWARDS, VALUES, ALIVE, ON_POLICY, Decay(0.5, 0.25))
    np.testing.assert_allclose(found, [[first, second, 4.0]])


def test_what_follows_an_action_that_was_tried_is_left_to_the_value():
    tried = jnp.array([[False, True, False]])
    found = lambda_returns(REWARDS, VALUES, ALIVE, tried, Decay(1.0, 1.0))
    np.testing.assert_allclose(found, [[1.0 + 5.0, 2.0 + 4.0, 4.0]])


def test_nothing_is_expected_after_the_end_of_an_episode():
    alive, rewards = jnp.array([[1.0, 1.0, 0.0]]), jnp.array([[1.0, 2.0, 0.0]])
    for trace in (0.0, 1.0):
        found = lambda_returns(rewards, VALUES, alive, ON_POLICY, Decay(1.0, trace))
        np.testing.assert_allclose(found[:, 1], [2.0])
    tried = jnp.array([[False, False, True]])
    found = lambda_returns(rewards, VALUES, alive, tried, Decay(1.0, 1.0))
    np.testing.assert_allclose(found[:, :2], [[3.0, 2.0]])
