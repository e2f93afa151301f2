"""The analysis pass: how the return answers to the action at each step."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.noise.actions import ActionSpec
from mdpo_rddl.noise.draws import zero_perturbation
from mdpo_rddl.planner.rollouts.compiled import PerturbedModel


@dataclass(frozen=True)
class NoiseShape:
    """What the noise of an update is made for.

    Attributes:
      specs: the fluents to perturb.
      horizon: number of steps H.
      batch_size: rollouts B of one update.
      dtype: floating type of the model.
    """

    specs: Mapping[str, ActionSpec]
    horizon: int
    batch_size: int
    dtype: jnp.dtype


class LossArguments(NamedTuple):
    """The arguments of JaxPlan's loss after the random key.

    Attributes:
      params, hyperparams: the policy's.
      fluents, nonfluents: the initial ones, the fluents with a batch axis [B, ...].
      model, critic: parameters of the model and the critic.
    """

    params: Any
    hyperparams: Any
    fluents: Any
    nonfluents: Any
    model: Any
    critic: Any


def compile_analysis(
    mean_loss: Callable, shape: NoiseShape, samples: int
) -> Callable[[Array, LossArguments], dict[str, Array]]:
    """The mean return's gradient with respect to the raw action at every step.

    Later actions answer through the policy: it is the gradient with respect to a
    perturbation, at zero.

    Args:
      mean_loss: JaxPlan's loss with the mean as its utility, over perturbed rollouts.
      shape: of the perturbation.
      samples: rollouts to average over, each with its own exogenous noise.

    Returns:
      A function of a key and the loss's arguments that gives per fluent the gradient
      [H, *action shape] in return per unit of the fluent's noise.
    """

    def analyse(key: Array, given: LossArguments) -> dict[str, Array]:
        # all rollouts of a batch start in the same state
        start = jax.tree.map(
            lambda f: jnp.broadcast_to(f[:1], (samples, *f.shape[1:])), given.fluents
        )

        def negative_return(perturbation):
            perturbed = PerturbedModel(given.model, perturbation)
            return mean_loss(key, *given._replace(fluents=start, model=perturbed))[0]

        silence = zero_perturbation(shape.horizon, shape.specs, samples, shape.dtype)
        gradients = jax.grad(negative_return)(silence)
        summed = {name: -jnp.sum(gradient, axis=0) for name, gradient in gradients.items()}
        for name, spec in shape.specs.items():
            if np.any(spec.unit != 1.0):
                summed[name] = summed[name] * jnp.asarray(spec.unit, shape.dtype)
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
