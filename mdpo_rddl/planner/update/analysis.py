"""The analysis pass: how the return answers to the action at each step."""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.noise.actions import ActionSpec
from mdpo_rddl.noise.draws import zero_perturbation
from mdpo_rddl.planner.rollouts.compiled import PerturbedModel


def compile_analysis(
    mean_loss: Callable,
    specs: Mapping[str, ActionSpec],
    horizon: int,
    samples: int,
    dtype: jnp.dtype,
) -> Callable[..., dict[str, Array]]:
    """The mean return's gradient with respect to the raw action at every step.

    Later actions answer through the policy: it is the gradient with respect to a
    perturbation, at zero.

    Args:
      mean_loss: JaxPlan's loss with the mean as its utility, over perturbed rollouts.
      specs: the fluents that are perturbed.
      horizon: number of steps H.
      samples: rollouts to average over, each with its own exogenous noise.
      dtype: floating type of the model.

    Returns:
      A function of a key, the policy's parameters and hyperparameters, the initial fluents
      [B, ...], the non-fluents, the model's and the critic's parameters, that gives per
      fluent the gradient [H, *action shape] in return per unit of the fluent's noise.
    """

    def analyse(key, params, hyperparams, fluents, nonfluents, model, critic):
        # all rollouts of a batch start in the same state
        start = jax.tree.map(lambda f: jnp.broadcast_to(f[:1], (samples, *f.shape[1:])), fluents)

        def negative_return(perturbation):
            perturbed = PerturbedModel(model, perturbation)
            return mean_loss(key, params, hyperparams, start, nonfluents, perturbed, critic)[0]

        silence = zero_perturbation(horizon, specs, samples, dtype)
        gradients = jax.grad(negative_return)(silence)
        summed = {name: -jnp.sum(gradient, axis=0) for name, gradient in gradients.items()}
        for name, spec in specs.items():
            if np.any(spec.unit != 1.0):
                summed[name] = summed[name] * jnp.asarray(spec.unit, dtype)
        return summed

    return analyse


def mean_loss(planner: Any) -> Callable:
    """JaxPlan's training loss with the mean as its utility, as the sensitivity is defined.

    Args:
      planner: whose rollouts are compiled.
    """
    utility, utility_kwargs = planner.utility, planner.utility_kwargs
    planner.utility, planner.utility_kwargs = jnp.mean, {}
    try:
        return planner._jax_loss(planner.train_rollouts)
    finally:
        planner.utility, planner.utility_kwargs = utility, utility_kwargs
