"""A policy as it is played: from a step and an observation to an action."""

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.problem.evaluation import Policy


def playable(
    planner: MDPOPlanner, params: Any, policy_hyperparams: Mapping[str, Any], seed: int
) -> Policy:
    """The policy with the given parameters, as `mdpo_rddl.problem.evaluation` plays it.

    Args:
      planner: the planner that the parameters belong to.
      params: parameters of one policy.
      policy_hyperparams: JaxPlan's policy hyperparameters.
      seed: of a policy that draws random numbers; step t uses the t-th key.
    """
    keys = step_keys(planner, seed)
    hyperparams = dict(policy_hyperparams)

    def policy(step: int, state: Mapping[str, Any]) -> Mapping[str, Any]:
        return planner.get_action(keys[step], params, step, dict(state), hyperparams)

    return policy


def step_keys(planner: MDPOPlanner, seed: int) -> np.ndarray:
    """The random key of each step, as a policy of that seed is played [steps, 2]."""
    steps = max(planner.horizon, planner.rddl.horizon)
    return np.asarray(jax.random.split(jax.random.PRNGKey(seed), steps))
