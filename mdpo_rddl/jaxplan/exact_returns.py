"""Returns on the exact model compiled by JaxPlan: no relaxation, no noise on the actions."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, random

from mdpo_rddl.jaxplan.planner import MDPOPlanner


def compile_exact_returns(planner: MDPOPlanner) -> Callable[[Array, Any], Array]:
    """Compiles test rollouts of several policies.

    Args:
      planner: a planner; its `batch_size_test` is the number of rollouts B of each policy.

    Returns:
      A function of one key per policy [P, 2] and the policies' parameters [P, ...] that gives
      the discounted returns [P, B]. They depend on a policy's own key and parameters alone.
    """
    start, nonfluents = planner._batched_init_subs(planner.test_compiled.init_values)[1]
    hyperparams = unit_hyperparams(planner)
    model = planner.test_compiled.model_aux["params"]
    discounted = planner._jax_return(False)

    def returns(key, params):
        log, _ = planner.test_rollouts(key, params, hyperparams, start, nonfluents, model)
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
