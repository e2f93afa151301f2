"""Many policies side by side on the exact model, compiled: no relaxation, no gradient."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from mdpo_rddl.features import observed_fluents
from mdpo_rddl.jaxplan.planner import MDPOPlanner
from mdpo_rddl.jaxplan.rollout import compile_rollouts
from mdpo_rddl.jaxplan.termination import stop_at_termination


def compile_returns(planner: MDPOPlanner, rollouts: int) -> Callable[[Array, Any], Array]:
    """Compiles rollouts of the planner's policy on the exact model.

    A reward after termination counts for nothing, whatever the planner's own switch says.

    Args:
      planner: the compiled planner.
      rollouts: number of rollouts N of each policy.

    Returns:
      A function of a random key and parameters with a leading axis of policies [P, ...] that
      gives their discounted returns [P, N]; all see the same random numbers.
    """
    play = _compile_play(planner, rollouts, with_states=False)
    return jax.jit(jax.vmap(lambda key, params: play(key, params)[0], in_axes=(None, 0)))


def compile_visits(
    planner: MDPOPlanner, rollouts: int
) -> Callable[[Array, Any], tuple[Array, dict[str, Array]]]:
    """As `compile_returns`, and what the policies saw.

    Returns:
      A function that gives the returns [P, N], and per observed fluent its values
      [P, N, H, *shape].
    """
    play = _compile_play(planner, rollouts, with_states=True)
    return jax.jit(jax.vmap(play, in_axes=(None, 0)))


def state_bytes(planner: MDPOPlanner) -> int:
    """Size of all fluents of one rollout at one step."""
    fluents, _ = planner._batched_init_subs(planner.test_compiled.init_values)[1]
    return sum(leaf[:1].nbytes for leaf in jax.tree.leaves(fluents))


def _compile_play(
    planner: MDPOPlanner, rollouts: int, with_states: bool
) -> Callable[[Array, Any], tuple[Array, dict[str, Array]]]:
    compiled = planner.test_compiled
    stopping = bool(planner.rddl.terminations)
    rollout = compile_rollouts(
        compiled,
        planner.plan.test_policy,
        planner.horizon,
        rollouts,
        check_constraints=stopping,
        cache_path_info=with_states,
        differentiated=False,
    )
    if stopping:
        rollout = stop_at_termination(rollout)
    fluents, nonfluents = planner._batched_init_subs(compiled.init_values)[1]
    start = jax.tree.map(partial(_repeat_first, count=rollouts), fluents)
    model = compiled.model_aux["params"]
    hyperparams = dict.fromkeys(planner.rddl.action_fluents, 1.0)
    seen = observed_fluents(planner.rddl)
    discounts = planner.rddl.discount ** jnp.arange(planner.horizon)

    def play(key: Array, params: Any) -> tuple[Array, dict[str, Array]]:
        log, _ = rollout(key, params, hyperparams, start, nonfluents, model)
        states = {name: log["fluents"][name] for name in seen} if with_states else {}
        return jnp.sum(discounts * log["reward"], axis=-1), states

    return play


def _repeat_first(leaf: Any, count: int) -> Array:
    return jnp.repeat(leaf[:1], count, axis=0)
