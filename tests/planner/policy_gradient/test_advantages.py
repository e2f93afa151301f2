"""Advantages, worked by hand."""

import jax.numpy as jnp
import numpy as np

from mdpo_rddl.planner.policy_gradient.advantages import (
    Decay,
    advantages,
    normalised,
    returns_from,
)

REWARDS = jnp.array([[1.0, 2.0, 4.0]])
VALUES = jnp.array([[3.0, 5.0, 1.0]])
ALIVE = jnp.ones((1, 3))


def test_the_critic_alone_and_the_rollout_alone():
    errors = [1.0 + 0.5 * 5.0 - 3.0, 2.0 + 0.5 * 1.0 - 5.0, 4.0 - 1.0]
    found = advantages(REWARDS, VALUES, ALIVE, Decay(0.5, 0.0))
    np.testing.assert_allclose(found, [errors])
    # with lambda 1 the values between cancel
    returns = np.array([[1.0 + 0.5 * (2.0 + 0.5 * 4.0), 2.0 + 0.5 * 4.0, 4.0]])
    found = advantages(REWARDS, VALUES, ALIVE, Decay(0.5, 1.0))
    np.testing.assert_allclose(found, returns - VALUES)
    np.testing.assert_allclose(returns_from(REWARDS, 0.5), returns)


def test_between_them_later_errors_count_less():
    errors = [1.0 + 5.0 - 3.0, 2.0 + 1.0 - 5.0, 4.0 - 1.0]
    expected = [errors[0] + 0.5 * (errors[1] + 0.5 * errors[2]), errors[1] + 0.5 * errors[2]]
    found = advantages(REWARDS, VALUES, ALIVE, Decay(1.0, 0.5))
    np.testing.assert_allclose(found, [[*expected, errors[2]]])


def test_nothing_is_expected_after_the_end_of_an_episode():
    alive = jnp.array([[1.0, 1.0, 0.0]])
    rewards = jnp.array([[1.0, 2.0, 0.0]])
    found = advantages(rewards, VALUES, alive, Decay(1.0, 1.0))
    np.testing.assert_allclose(found[:, :2], [[3.0 - 3.0, 2.0 - 5.0]])


def test_only_the_steps_that_count_are_normalised():
    values = jnp.array([[1.0, 3.0, 700.0]])
    found = normalised(values, jnp.array([[1.0, 1.0, 0.0]]))
    np.testing.assert_allclose(found[:, :2], [[-1.0, 1.0]], rtol=2e-3)
