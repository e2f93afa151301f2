"""One iteration of MDPO: analyse, draw the noise, and let JaxPlan's update follow it."""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import numpy as np
from jax import Array, random

from mdpo_rddl.noise import ActionNoise
from mdpo_rddl.noise.actions import ActionSpec
from mdpo_rddl.noise.draws import draw_perturbation
from mdpo_rddl.planner.plans.opened import open_plan
from mdpo_rddl.planner.programs.staging import with_fast_random_numbers
from mdpo_rddl.planner.rollouts.compiled import PerturbedModel
from mdpo_rddl.planner.update.analysis import LossArguments, NoiseShape
from mdpo_rddl.planner.upstream import JaxPlan

# folded into JaxPlan's key of an iteration, so that the model draws what it draws in JaxPlan
_ANALYSIS_STREAM = 0x616E61
_UPDATE_STREAM = 0x757064


def noisy_update(
    plain_update: Callable,
    analyse: Callable[[Array, LossArguments], dict[str, Array]] | None,
    sensed: Callable | None,
    shape: NoiseShape,
    parallel_updates: int,
) -> Callable:
    """JaxPlan's update, with noise on the actions of its rollouts.

    Args:
      plain_update: JaxPlan's update, whose rollouts take a `PerturbedModel`.
      analyse: gives the gradients that the noise rule asks for (`compile_analysis`), if it does.
      sensed: takes from the gradient of the parameters that with respect to the raw actions, for
        a rule that asks for no analysis: the update before then stands in for it.
      shape: of the noise.
      parallel_updates: policies that are updated side by side.

    Returns:
      A pure function with the arguments and results of JaxPlan's update; `opt_aux["noise"]`
      holds each policy's noise rule and its state, `opt_aux["sensed"]` what was sensed if
      anything is, and the log also `sigma` and `sensitivity`.
    """

    draw_fast = with_fast_random_numbers(
        lambda key, sigma: draw_perturbation(key, sigma, shape.specs, shape.batch_size, shape.dtype)
    )

    def draw(key, given, noise_and_state, last):
        noise, state = noise_and_state
        gradients = last
        if analyse is not None:
            gradients = analyse(random.fold_in(key, _ANALYSIS_STREAM), given)
        profile, state = noise.profile(gradients, state, shape.horizon)
        update_key = random.fold_in(key, _UPDATE_STREAM)
        perturbation = draw_fast(update_key, profile.sigma)
        return perturbation, profile, (noise, state)

    # each policy has its own parameters, and model's parameters
    axes = LossArguments(0, None, None, None, 0, None)
    batched_draw = jax.vmap(draw, in_axes=(0, axes, 0, 0))

    def update(*arguments):
        key, *loss_arguments, opt_state, opt_aux = arguments
        given = LossArguments(*loss_arguments)
        keys = random.split(key, parallel_updates)
        perturbation, profile, noise_and_state = batched_draw(
            keys, given, opt_aux["noise"], opt_aux.get("sensed")
        )
        opt_aux = {**opt_aux, "noise": noise_and_state}
        perturbed = given._replace(model=PerturbedModel(given.model, perturbation))
        result = plain_update(key, *perturbed, opt_state, opt_aux)
        opt_aux, aux, log, model = result[3:7]
        if sensed is not None:
            opt_aux = {**opt_aux, "sensed": sensed(log["grad"])}
        log = {**log, "sigma": profile.sigma, "sensitivity": profile.sensitivity}
        return (*result[:3], opt_aux, aux, log, model.params, *result[7:])

    return update


def sensed_gradients(
    plan: JaxPlan, noise: ActionNoise, specs: Mapping[str, ActionSpec]
) -> Callable | None:
    """What takes the raw actions' gradients from the parameters', for a rule without an analysis.

    They are in the noise's unit, as those of an analysis are.

    Args:
      plan: the compiled plan; most have no such function.
      noise: the rule.
      specs: the fluents that take noise, with its unit.
    """
    opened = open_plan(plan)
    gradients = opened.action_gradients
    if noise.analysis_samples or gradients is None:
        return None
    ratios = {
        name: np.asarray(spec.unit) / opened.units[name]
        for name, spec in specs.items()
        if name in opened.units
    }

    def sensed(gradient: Any) -> dict[str, Array]:
        found = gradients(gradient)
        scaled = {name: found[name] * ratio for name, ratio in ratios.items() if np.any(ratio != 1)}
        return {**found, **{n: value.astype(found[n].dtype) for n, value in scaled.items()}}

    return sensed
