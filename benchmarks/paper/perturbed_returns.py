"""The expected return under action noise, as a function of the policy's parameters."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jax import Array, random

from mdpo_rddl.noise.draws import draw_perturbation
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.rollouts.compiled import PerturbedModel
from mdpo_rddl.planner.start import initial_values, unit_hyperparams


def perturbed_mean_return(planner: MDPOPlanner, sigma: float) -> Callable[[Array, Any], Array]:
    """The mean return of a training batch with noise on the actions.

    Args:
      planner: a noisy planner.
      sigma: standard deviation at every step, in the unit of the raw action.

    Returns:
      A pure function of a key, which fixes the model's and the actions' noise, and the policy's
      parameters, whose gradient is the one that the planner follows.
    """
    fluents, nonfluents = initial_values(planner).training
    hyperparams = unit_hyperparams(planner)
    profile = jnp.full(planner.horizon, sigma)
    shape = planner.action_specs, planner.batch_size_train, planner.compiled.REAL

    def mean_return(key, params):
        model_key, noise_key = random.split(key)
        perturbation = draw_perturbation(noise_key, profile, *shape)
        model = PerturbedModel(planner.compiled.model_aux["params"], perturbation)
        arguments = (hyperparams, fluents, nonfluents, model, None)
        return -planner.single_train_loss(model_key, params, *arguments)[0]

    return mean_return
