"""The parts of an MDPO iteration on their own, to see what each of them costs."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax, random

from mdpo_rddl.jaxplan.planner import MDPOPlanner
from mdpo_rddl.jaxplan.rollout import PerturbedModel
from mdpo_rddl.jaxplan.sharding import shard
from mdpo_rddl.noise.draws import draw_perturbation, zero_perturbation
from mdpo_rddl.staging import with_fast_random_numbers

BOTH_GRADIENTS = "both gradients"
ANALYSIS, UPDATE, SCALE, DRAW = "analysis gradient", "update gradient", "noise's scale", "its draw"
PARTS = (BOTH_GRADIENTS, ANALYSIS, UPDATE, SCALE, DRAW)


def compile_part(planner: MDPOPlanner, key: Any, part: str) -> Callable[[int], Any]:
    """Compiles iterations that do one part of MDPO's and nothing else.

    The parameters stay as they are initialised: nothing is updated, logged or tested. The two
    gradients are what no implementation can save.

    Args:
      planner: a planner whose noise needs an analysis.
      key: JAX random key of the initial parameters.
      part: one of `PARTS`.

    Returns:
      A function of a number of iterations, whose result is ready when they are done.
    """
    start, _ = planner._batched_init_subs(planner.test_compiled.init_values)
    hyperparams = dict.fromkeys(planner.rddl.action_fluents, 1.0)
    params, _, _ = planner.initialize(key, hyperparams, start[0])
    model = planner._broadcast_pytree(planner.compiled.model_aux["params"])
    analyse, loss = planner._jax_analysis(), planner.single_train_loss
    shape = planner.action_specs, planner.batch_size_train, planner.compiled.REAL
    keys = shard(random.split(key, planner.parallel_updates), planner._sharding)

    # each iteration must depend on the one before, or the compiler would make only one
    def analysis_gradient(key, params, model, gradients, disturbance):
        moved = jax.tree.map(lambda p: p + disturbance, params)
        return analyse(key, moved, hyperparams, *start, model, None)

    def update_gradient(key, params, model, gradients, disturbance):
        silence = zero_perturbation(planner.horizon, *shape)
        perturbation = jax.tree.map(lambda p: p + disturbance, silence)
        perturbed = PerturbedModel(model, perturbation)
        return jax.grad(lambda p: loss(key, p, hyperparams, *start, perturbed, None)[0])(params)

    def both_gradients(key, *arguments):
        # two rollouts, two draws of the model's random numbers
        analysis = analysis_gradient(random.fold_in(key, 1), *arguments)
        return analysis, update_gradient(key, *arguments)

    def scale(key, params, model, gradients, disturbance):
        moved = jax.tree.map(lambda g: g + disturbance, gradients)
        return planner.noise.profile(moved, planner.noise.initial_state(0), planner.horizon)[0]

    def draw(key, params, model, gradients, disturbance):
        sigma = jnp.full(planner.horizon, 1.0 + disturbance)
        draw_fast = with_fast_random_numbers(lambda *given: draw_perturbation(*given, *shape))
        return draw_fast(key, sigma)

    functions = (both_gradients, analysis_gradient, update_gradient, scale, draw)
    function = dict(zip(PARTS, functions, strict=True))[part]

    def total(*arguments) -> Array:
        leaves = jax.tree.leaves(function(*arguments))
        return 1e-30 * sum(map(jnp.sum, leaves), start=jnp.zeros(()))

    @jax.jit
    def iterate(count, params, model, gradients):
        def one(number, disturbance):
            own = jax.vmap(random.fold_in, (0, None))(keys, number)
            return jax.vmap(total)(own, params, model, gradients, disturbance)

        return lax.fori_loop(0, count, one, jnp.zeros(planner.parallel_updates))

    zeros = jnp.zeros(planner.parallel_updates)
    gradients = jax.jit(jax.vmap(analysis_gradient, (0, 0, 0, None, 0)))(
        keys, params, model, None, zeros
    )
    return lambda count: iterate(count, params, model, gradients)
