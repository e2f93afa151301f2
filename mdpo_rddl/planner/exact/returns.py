"""Returns of many policies at once, on the exact model as JaxPlan compiles it or a relaxed one."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.start import initial_values, unit_hyperparams


def compile_returns(planner: MDPOPlanner, relaxed: bool = False) -> Callable[[Array, Any], Array]:
    """Compiles rollouts of several policies without noise on their actions.

    Args:
      planner: a planner; its test batch is the number of rollouts B of each policy, its
        training batch that on the relaxed model.
      relaxed: whether the model is the planner's relaxed one.

    Returns:
      A function of one key per policy [P, 2] and the policies' parameters [P, ...] that gives
      the discounted returns [P, B]. They depend on a policy's own key and parameters alone.
    """
    starts = initial_values(planner)
    start, nonfluents = starts.training if relaxed else starts.test
    model = planner.compiled if relaxed else planner.test_compiled
    rollouts = planner.train_rollouts if relaxed else planner.test_rollouts
    hyperparams = unit_hyperparams(planner)
    discounted = planner._jax_return(False)

    def returns(key, params):
        model_params = model.model_aux["params"]
        log, _ = rollouts(key, params, hyperparams, start, nonfluents, model_params)
        rewards = log["reward"]
        return discounted(rewards, jnp.zeros(rewards.shape[0], rewards.dtype))

    return jax.jit(jax.vmap(returns))
