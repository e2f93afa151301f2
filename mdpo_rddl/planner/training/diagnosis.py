"""Where a number that is not finite comes from, and what to try where training gets nowhere."""

import time
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.opened import open_plan
from mdpo_rddl.planner.start import initial_parameters, initial_values, unit_hyperparams
from mdpo_rddl.planner.training.found import Found, select_restart
from mdpo_rddl.planner.update.restarts import PerRestart

_SECONDS = 10.0


def origin(planner: MDPOPlanner, params: Any, seconds: float = _SECONDS) -> str | None:
    """Replays a rollout of the relaxed model, without noise, expression by expression.

    Args:
      planner: compiled.
      params: parameters of one policy.
      seconds: that it may take, about.

    Returns:
      The first expression whose value or derivative is not finite, and the step; None if there
      is none, or none was met in that time.
    """
    compiled, horizon = planner.compiled, planner.horizon
    fluents, nonfluents = initial_values(planner).training
    fluents = {name: jnp.asarray(value[0]) for name, value in fluents.items()}
    hyperparams, model = unit_hyperparams(planner), compiled.model_aux["params"]
    expressions = {f"the cpf of {name}": (name, cpf) for name, cpf in compiled.cpfs.items()}
    expressions["the reward"] = ("", compiled.reward)
    values = {what: jax.jit(function) for what, (_, function) in expressions.items()}
    slopes = {what: jax.jit(_slope(function)) for what, (_, function) in expressions.items()}
    policy = jax.jit(planner.plan.train_policy)
    key, until = jax.random.PRNGKey(0), time.monotonic() + seconds
    memory = open_plan(planner.plan).memory
    entries = memory.initial
    for step in range(horizon):
        key, *keys = jax.random.split(key, 2 + len(expressions))
        actions = policy(keys[0], params, hyperparams, step, fluents, entries)
        entries = memory.update(entries, step, fluents, actions)
        for name, value in actions.items():
            if not _is_finite(value):
                return f"the action {name} at step {step + 1}"
        fluents = {**fluents, **actions}
        for subkey, (what, (name, _)) in zip(keys[1:], expressions.items(), strict=True):
            value = values[what](fluents, nonfluents, model, subkey)[0]
            if not _is_finite(value):
                return f"{what} at step {step + 1}"
            if not _is_finite(slopes[what](fluents, nonfluents, model, subkey)):
                return f"the derivative of {what} at step {step + 1}"
            if name:
                fluents = {**fluents, name: value}
            if time.monotonic() > until:
                return None
        following = {state: fluents[after] for state, after in planner.rddl.next_state.items()}
        fluents = {**fluents, **following}
    return None


def _slope(function: Any) -> Any:
    """The gradient of the sum of an expression's values by all real fluents."""

    def total(real: Mapping[str, Any], other: Mapping[str, Any], *rest: Any) -> Any:
        return jnp.sum(jnp.asarray(function({**other, **real}, *rest)[0], float))

    def slope(fluents: Mapping[str, Any], *rest: Any) -> Any:
        real = {n: v for n, v in fluents.items() if jnp.issubdtype(v.dtype, jnp.floating)}
        other = {name: value for name, value in fluents.items() if name not in real}
        return jax.grad(total)(real, other, *rest)

    return slope


def _is_finite(tree: Any) -> bool:
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(tree)]
    return all(np.isfinite(leaf).all() for leaf in leaves if leaf.dtype.kind in "fc")


def what_to_try(
    planner: MDPOPlanner, found: Found, key: Any, guess: Any = None, seconds: float = _SECONDS
) -> str | None:
    """What went wrong with a training and what to try, in a sentence.

    Args:
      planner: that was trained.
      found: what the iterations have found.
      key: of the training.
      guess: what the training began with, as JaxPlan takes it; None for parameters by the key.
      seconds: that a replay may take, about.

    Returns:
      The sentence; None if nothing went wrong.
    """
    if found.not_finite:
        message = (
            f"{found.not_finite:,} returns were not finite, the first in iteration "
            f"{found.first_not_finite + 1:,}"
        )
        message += _at(planner, lambda: _suspect(planner, found, key, guess), seconds)
        return f"{message}: try a smaller learning rate, sigma or weight, or clip_grad"
    if found.lost_sensitivities:
        message = f"{found.lost_sensitivities:,} sensitivities of a step were not finite"
        message += _at(planner, lambda: _suspect(planner, found, key, guess), seconds)
        return f"{message}: they count as zero, and those steps have the smallest sigma"
    if found.is_flat:
        return (
            "all gradients were zero, the return does not answer to the actions here: try more "
            "noise (--sigma-max), another seed, a smaller relaxation weight or --preset auto"
        )
    return None


def _suspect(planner: MDPOPlanner, found: Found, key: Any, guess: Any) -> Any:
    """Parameters that led to what is not finite; those of the beginning if it was there at once."""
    if found.suspect is not None:
        return found.suspect
    if guess is None:
        return select_restart(initial_parameters(planner, key), 0)
    return select_restart(guess.params, 0) if isinstance(guess, PerRestart) else guess


def _at(planner: MDPOPlanner, suspect: Callable[[], Any], seconds: float) -> str:
    """What is first not finite with these parameters, in brackets."""
    try:
        where = origin(planner, suspect(), seconds)
    except Exception as error:  # it must not hide what is to be told
        where = f"cannot be replayed: {type(error).__name__}"
    return f" (first not finite: {where})" if where else ""
