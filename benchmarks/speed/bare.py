"""The parts of an MDPO iteration on their own, to see what each of them costs."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax, random

from mdpo_rddl.noise.draws import draw_perturbation
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.programs.staging import with_fast_random_numbers
from mdpo_rddl.planner.rollouts.compiled import PerturbedModel
from mdpo_rddl.planner.start import initial_values, unit_hyperparams
from mdpo_rddl.planner.update.analysis import LossArguments
from mdpo_rddl.planner.update.sharding import shard

BOTH_GRADIENTS = "both gradients"
ANALYSIS, UPDATE, SCALE, DRAW = "analysis gradient", "update gradient", "noise's scale", "its draw"
PARTS = (BOTH_GRADIENTS, ANALYSIS, UPDATE, SCALE, DRAW)


class _Given(NamedTuple):
    """What the parts need of each other, for one seed.

    Attributes:
      start: batched initial fluents and non-fluents, the same for all seeds.
      params, model: the policy's and the relaxed model's parameters.
      gradients: of the analysis, per fluent [H, *action shape].
      perturbation: per fluent [B, H, *action shape].
    """

    start: Any
    params: Any
    model: Any
    gradients: Any
    perturbation: Any


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
    start = initial_values(planner).training
    hyperparams = unit_hyperparams(planner)
    analyse, loss, noise = planner.compile_analysis(), planner.single_train_loss, planner.noise
    shape = planner.action_specs, planner.batch_size_train, planner.compiled.REAL
    draw_noise = with_fast_random_numbers(lambda key, sigma: draw_perturbation(key, sigma, *shape))

    # each iteration must depend on the one before, or the compiler would make only one
    def analysis_gradient(key, given, disturbance):
        moved = jax.tree.map(lambda p: p + disturbance, given.params)
        return analyse(key, LossArguments(moved, hyperparams, *given.start, given.model, None))

    def update_gradient(key, given, disturbance):
        moved = jax.tree.map(lambda p: p + disturbance, given.params)
        perturbed = PerturbedModel(given.model, given.perturbation)
        arguments = (hyperparams, *given.start, perturbed, None)
        return jax.grad(lambda params: loss(key, params, *arguments)[0])(moved)

    def both_gradients(key, given, disturbance):
        # two rollouts, two draws of the model's random numbers
        analysis = analysis_gradient(random.fold_in(key, 1), given, disturbance)
        return analysis, update_gradient(key, given, disturbance)

    def scale(key, given, disturbance):
        moved = jax.tree.map(lambda g: g + disturbance, given.gradients)
        return noise.profile(moved, noise.initial_state(planner.horizon), planner.horizon)[0]

    def draw(key, given, disturbance):
        return draw_noise(key, jnp.full(planner.horizon, 1.0 + disturbance))

    functions = (both_gradients, analysis_gradient, update_gradient, scale, draw)
    function = dict(zip(PARTS, functions, strict=True))[part]

    def total(key: Array, given: _Given, disturbance: Array) -> Array:
        leaves = jax.tree.leaves(function(key, given, disturbance))
        return 1e-30 * sum(map(jnp.sum, leaves), start=jnp.zeros(()))

    axes = _Given(None, 0, 0, 0, 0)

    @jax.jit
    def iterate(count, keys, given):
        def one(number, disturbance):
            own = jax.vmap(random.fold_in, (0, None))(keys, number)
            return jax.vmap(total, (0, axes, 0))(own, given, disturbance)

        return lax.fori_loop(0, count, one, jnp.zeros(planner.parallel_updates))

    def first(key, start, params, model):
        given = _Given(start, params, model, None, None)
        gradients = analysis_gradient(key, given, 0.0)
        return given._replace(gradients=gradients, perturbation=draw(key, given, 0.0))

    keys = shard(random.split(key, planner.parallel_updates), planner._sharding)
    params, _, _ = planner.initialize(key, hyperparams, start[0])
    model = planner._broadcast_pytree(planner.compiled.model_aux["params"])
    given = jax.jit(jax.vmap(first, (0, None, 0, 0), axes))(keys, start, params, model)
    return lambda count: iterate(count, keys, given)
