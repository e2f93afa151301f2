"""Exact returns of the seeds' best iterates, by the planner's own test where that is exact."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import random

from mdpo_rddl.planner.exact.exact import exact_returns
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.start import initial_values, unit_hyperparams

# no key of a training
_EVALUATION_KEY = 2**31 - 1


def mean_returns(planner: MDPOPlanner, params: Any, rollouts: int) -> np.ndarray:
    """The mean return of each policy on the exact model, on the same random numbers for all calls.

    JaxPlan's compiled test is the exact environment where nothing ends an episode and no rule
    limits the actions; it costs no other compilation.

    Args:
      planner: whose test batch and parallel updates say what one of its tests plays.
      params: parameters of the policies [S, ...].
      rollouts: of each, at least.

    Returns:
      [S].
    """
    rddl = planner.rddl
    if rddl.terminations or rddl.invariants or planner.legal_policy is not planner.plan.test_policy:
        returns = exact_returns(planner, rollouts)(random.PRNGKey(_EVALUATION_KEY), params)
        return np.asarray(returns, float).mean(axis=1)
    return _by_tests(planner, params, rollouts)


def _by_tests(planner: MDPOPlanner, params: Any, rollouts: int) -> np.ndarray:
    seeds = jax.tree.leaves(params)[0].shape[0]
    copies = planner.parallel_updates // seeds
    lanes = jax.tree.map(lambda leaf: jnp.repeat(leaf, copies, axis=0), params)
    model = planner._broadcast_pytree(planner.test_compiled.model_aux["params"])
    start, hyperparams = initial_values(planner).test, unit_hyperparams(planner)
    tests = -(-rollouts // (copies * planner.batch_size_test))
    discounts = planner.rddl.discount ** np.arange(planner.horizon)
    found = []
    for key in random.split(random.PRNGKey(_EVALUATION_KEY), tests):
        _, (log, _) = planner.test_loss(key, lanes, hyperparams, *start, model, None)
        returns = np.asarray(log["reward"], float) @ discounts
        found.append(returns.reshape(seeds, -1))
    return np.concatenate(found, axis=1).mean(axis=1)
