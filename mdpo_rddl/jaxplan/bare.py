"""The two gradients of an MDPO iteration and nothing else: what no implementation can save."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax, random

from mdpo_rddl.jaxplan.planner import MDPOPlanner
from mdpo_rddl.jaxplan.rollout import PerturbedModel
from mdpo_rddl.jaxplan.sharding import shard
from mdpo_rddl.noise.draws import zero_perturbation


def compile_bare_gradients(planner: MDPOPlanner, key: Any) -> Callable[[int], Any]:
    """Compiles iterations that differentiate the analysis and the update rollout.

    The parameters stay as they are initialised: no noise is drawn, nothing is updated, logged
    or tested.

    Args:
      planner: a planner whose noise needs an analysis.
      key: JAX random key of the initial parameters.

    Returns:
      A function of a number of iterations, whose result is ready when they are done.
    """
    start, _ = planner._batched_init_subs(planner.test_compiled.init_values)
    hyperparams = dict.fromkeys(planner.rddl.action_fluents, 1.0)
    params, _, _ = planner.initialize(key, hyperparams, start[0])
    model = planner._broadcast_pytree(planner.compiled.model_aux["params"])
    analyse, loss = planner._jax_analysis(), planner.single_train_loss
    silence = zero_perturbation(
        planner.horizon, planner.action_specs, planner.batch_size_train, planner.compiled.REAL
    )
    keys = shard(random.split(key, planner.parallel_updates), planner._sharding)

    def both(key, params, model, disturbance):
        # two rollouts, two draws of the model's random numbers
        own_key = random.fold_in(key, 1)
        sensitivity = analyse(own_key, params, hyperparams, *start, model, None)
        # each gradient must depend on the one before, or the compiler would make it only once
        perturbation = jax.tree.map(lambda p: p + disturbance, silence)
        perturbed = PerturbedModel(model, perturbation)
        gradient = jax.grad(lambda p: loss(key, p, hyperparams, *start, perturbed, None)[0])
        leaves = jax.tree.leaves((sensitivity, gradient(params)))
        return 1e-30 * sum(jnp.sum(leaf) for leaf in leaves)

    @jax.jit
    def iterate(count, params, model):
        def one(number, disturbance):
            own = jax.vmap(random.fold_in, (0, None))(keys, number)
            return jax.vmap(both)(own, params, model, disturbance)

        return lax.fori_loop(0, count, one, jnp.zeros(planner.parallel_updates))

    return lambda count: iterate(count, params, model)
