"""Rollouts of the relaxed model under a perturbed policy."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, random

from mdpo_rddl.jaxplan.memory import bounded_step
from mdpo_rddl.jaxplan.perturbed_policy import PerturbedPolicy


class PerturbedModel(NamedTuple):
    """The relaxed model's parameters together with the perturbation of one batch of rollouts.

    JaxPlan hands the loss one argument that differs between its parallel updates, the model
    parameters; the perturbation travels there.

    Attributes:
      params: JaxPlan's model parameters (relaxation weights by expression).
      perturbation: per action fluent, [B, H, *action shape].
    """

    params: Any
    perturbation: dict[str, Array]


def compile_perturbed_rollouts(
    compiled: Any,
    policy: PerturbedPolicy,
    horizon: int,
    *,
    history_dependent: bool = False,
    check_constraints: bool = False,
    cache_path_info: bool = False,
) -> Callable[..., tuple[dict[str, Any], Any]]:
    """Compiles rollouts that take a `PerturbedModel` where JaxPlan's take model parameters.

    The random numbers are drawn in JaxPlan's order, so with a zero perturbation the rollout
    is the one that `JaxRDDLCompiler.compile_rollouts` makes from the same key. The
    perturbation is scanned over, which keeps its gradient linear in the horizon; as a
    policy hyperparameter its gradient would be accumulated whole at every step.

    Args:
      compiled: JaxPlan's compiled relaxed model.
      policy: the perturbed policy.
      horizon: number of steps H.
      history_dependent: whether the policy reads the fluents' history.
      check_constraints: whether the log tells preconditions, invariants and termination.
      cache_path_info: whether the log keeps every fluent at every step.

    Returns:
      rollout(key, policy_params, policy_hyperparams, fluents, nonfluents, model), with a
      leading batch axis B on the fluents, giving JaxPlan's log [B, H, ...] and the model
      parameters.
    """
    transition = compiled.compile_transition(
        check_constraints=check_constraints, cache_path_info=cache_path_info
    )

    def one_step(key, perturbation, fluents, history, params, hyperparams, step, nonfluents, model):
        key, model_key = random.split(key)
        actions = policy(key, params, hyperparams, step, fluents, history, perturbation)
        return transition(model_key, actions, fluents, nonfluents, model)

    batched_step = jax.vmap(one_step, in_axes=(0, 0, 0, 1, None, None, None, None, None))

    def rollout(key, params, hyperparams, fluents, nonfluents, model: PerturbedModel):
        batch_size = jax.tree.leaves(model.perturbation)[0].shape[0]

        def scanned_step(carry, inputs):
            key, fluents, history, model_params = carry
            step, perturbation = inputs
            if history_dependent:
                history = jax.tree.map(lambda past, now: past.at[step].set(now), history, fluents)
            keys = random.split(key, 1 + batch_size)
            fluents, log, model_params = batched_step(
                keys[1:],
                perturbation,
                fluents,
                history,
                params,
                hyperparams,
                step,
                nonfluents,
                model_params,
            )
            # every rollout returns the same model parameters
            model_params = jax.tree.map(lambda leaf: leaf[0], model_params)
            return (keys[0], fluents, history, model_params), log

        history = {}
        if history_dependent:
            history = jax.tree.map(lambda f: jnp.zeros((horizon, *f.shape), f.dtype), fluents)
        by_step = jax.tree.map(lambda p: jnp.swapaxes(p, 0, 1), model.perturbation)
        start = (key, fluents, history, model.params)
        inputs = (jnp.arange(horizon), by_step)
        first = jax.tree.map(lambda leaf: leaf[0], inputs)
        step = bounded_step(scanned_step, start, first, horizon)
        end, log = jax.lax.scan(step, start, inputs)

        log = jax.tree.map(lambda leaf: jnp.swapaxes(leaf, 0, 1), log)
        if not log["fluents"]:
            # JaxPlan's critic reads the last state even where no path is kept
            log["fluents"] = {name: value[:, jnp.newaxis] for name, value in end[1].items()}
        return log, end[3]

    return rollout
