"""One iteration of MDPO: analyse, draw the noise, and let JaxPlan's update follow it."""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
from jax import random

from mdpo_rddl.noise import ActionNoise
from mdpo_rddl.noise.actions import ActionSpec
from mdpo_rddl.noise.draws import draw_perturbation
from mdpo_rddl.planner.programs.staging import with_fast_random_numbers
from mdpo_rddl.planner.rollouts.compiled import PerturbedModel

# folded into JaxPlan's key of an iteration, so that the model draws what it draws in JaxPlan
_ANALYSIS_STREAM = 0x616E61
_UPDATE_STREAM = 0x757064


def noisy_update(
    plain_update: Callable,
    analyse: Callable | None,
    sensed: Callable | None,
    specs: Mapping[str, ActionSpec],
    *,
    horizon: int,
    batch_size: int,
    parallel_updates: int,
    dtype: jnp.dtype,
) -> Callable:
    """JaxPlan's update, with noise on the actions of its rollouts.

    Args:
      plain_update: JaxPlan's update, whose rollouts take a `PerturbedModel`.
      analyse: gives the gradients that the noise rule asks for (`compile_analysis`), if it does.
      sensed: takes from the gradient of the parameters that with respect to the raw actions, for
        a rule that asks for no analysis: the update before then stands in for it.
      specs: the fluents to perturb.
      horizon: number of steps H.
      batch_size: rollouts of one update.
      parallel_updates: policies that are updated side by side.
      dtype: floating type of the model.

    Returns:
      A pure function with the arguments and results of JaxPlan's update; `opt_aux["noise"]`
      holds each policy's noise rule and its state, `opt_aux["sensed"]` what was sensed if
      anything is, and the log also `sigma` and `sensitivity`.
    """

    draw_fast = with_fast_random_numbers(
        lambda key, sigma: draw_perturbation(key, sigma, specs, batch_size, dtype)
    )

    def draw(key, params, hyperparams, fluents, nonfluents, model, critic, noise_and_state, last):
        noise, state = noise_and_state
        gradients = last
        if analyse is not None:
            analysis_key = random.fold_in(key, _ANALYSIS_STREAM)
            gradients = analyse(
                analysis_key, params, hyperparams, fluents, nonfluents, model, critic
            )
        profile, state = noise.profile(gradients, state, horizon)
        update_key = random.fold_in(key, _UPDATE_STREAM)
        perturbation = draw_fast(update_key, profile.sigma)
        return perturbation, profile, (noise, state)

    batched_draw = jax.vmap(draw, in_axes=(0, 0, None, None, None, 0, None, 0, 0))

    def update(key, params, hyperparams, fluents, nonfluents, model, critic, opt_state, opt_aux):
        keys = random.split(key, parallel_updates)
        shared = (hyperparams, fluents, nonfluents)
        perturbation, profile, noise_and_state = batched_draw(
            keys, params, *shared, model, critic, opt_aux["noise"], opt_aux.get("sensed")
        )
        opt_aux = {**opt_aux, "noise": noise_and_state}
        perturbed = PerturbedModel(model, perturbation)
        result = plain_update(key, params, *shared, perturbed, critic, opt_state, opt_aux)
        opt_aux, aux, log = result[3:6]
        if sensed is not None:
            opt_aux = {**opt_aux, "sensed": sensed(log["grad"])}
        log = {**log, "sigma": profile.sigma, "sensitivity": profile.sensitivity}
        return (*result[:3], opt_aux, aux, log, *result[6:])

    return update


def sensed_gradients(plan: Any, noise: ActionNoise) -> Callable | None:
    """What takes the raw actions' gradients from the parameters', for a rule without an analysis.

    Args:
      plan: says so by a function `action_gradients`; most have none.
      noise: the rule.
    """
    return None if noise.analysis_samples else getattr(plan, "action_gradients", None)
