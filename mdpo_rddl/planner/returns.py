"""Returns of many policies at once, on the exact model as JaxPlan compiles it or a relaxed one."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, random

from mdpo_rddl.planner.planner import MDPOPlanner


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
    starts = planner._batched_init_subs(planner.test_compiled.init_values)
    start, nonfluents = starts[0] if relaxed else starts[1]
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


def initial_parameters(planner: MDPOPlanner, key: Any) -> Any:
    """The parameters [R, ...] that JaxPlan's `optimize(key)` begins with.

    Those of one restart do not depend on how many there are.
    """
    (fluents, _), _ = planner._batched_init_subs(planner.test_compiled.init_values)
    return planner.initialize(random.split(key)[1], unit_hyperparams(planner), fluents)[0]


def unit_hyperparams(planner: MDPOPlanner) -> dict[str, float]:
    """JaxPlan's policy hyperparameters where none are given."""
    return dict.fromkeys(planner.rddl.action_fluents, 1.0)
