"""Many policies side by side on the exact model, compiled: no relaxation, no gradient."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.features import observed_fluents
from mdpo_rddl.planner.rollouts.compiled import RolloutOptions, compile_rollouts
from mdpo_rddl.planner.rollouts.termination import stop_at_termination
from mdpo_rddl.planner.start import initial_values, unit_hyperparams
from mdpo_rddl.problem.limits import group_limits


def compile_exact_returns(
    planner: MDPOPlanner, rollouts: int, side_by_side: int | None = None
) -> Callable[[Array, Any], Array]:
    """Compiles rollouts of the planner's policy on the exact model.

    A reward after termination does not count, whatever the planner's own switch says; where an
    action breaks a precondition the no-op is played.

    Args:
      planner: the compiled planner.
      rollouts: number of rollouts N of each policy.
      side_by_side: policies that are computed at once; all if None.

    Returns:
      A function of a random key and parameters with a leading axis of policies [P, ...] that
      gives their discounted returns [P, N]; all see the same random numbers.
    """
    play = _compile_play(planner, rollouts, with_states=False)
    return _over_policies(lambda key, params: play(key, params)[0], side_by_side)


def compile_visits(
    planner: MDPOPlanner, rollouts: int, side_by_side: int | None = None
) -> Callable[[Array, Any], tuple[Array, dict[str, Array]]]:
    """As `compile_exact_returns`, and what the policies saw.

    Returns:
      A function that gives the returns [P, N], and per observed fluent its values
      [P, N, H, *shape].
    """
    return _over_policies(_compile_play(planner, rollouts, with_states=True), side_by_side)


def step_bytes(planner: MDPOPlanner) -> int:
    """What one rollout of a feedback policy holds at one step, about: fluents and features."""
    fluents = initial_values(planner).test.fluents
    state = sum(leaf[:1].nbytes for leaf in jax.tree.leaves(fluents))
    feedback = planner.feedback_plan.feedback
    real = jnp.dtype(planner.compiled.REAL).itemsize
    features = sum(
        len(feedback.names(name)) * math.prod(shape) * real
        for name, shape in feedback.action_shapes.items()
    )
    return state + features


def _over_policies(play: Callable[..., Any], side_by_side: int | None) -> Callable[..., Any]:
    if side_by_side is None:
        return jax.jit(jax.vmap(play, in_axes=(None, 0)))
    return jax.jit(lambda key, params: lax.map(partial(play, key), params, batch_size=side_by_side))


def _compile_play(
    planner: MDPOPlanner, rollouts: int, with_states: bool
) -> Callable[[Array, Any], tuple[Array, dict[str, Array]]]:
    compiled = planner.test_compiled
    stopping = bool(planner.rddl.terminations)
    fluents, nonfluents = initial_values(planner).test
    policy = planner.plan.test_policy
    if group_limits(planner.rddl)[1]:
        policy = _legal(policy, compiled, nonfluents)
    options = RolloutOptions(
        check_constraints=stopping, cache_path_info=with_states, differentiated=False
    )
    rollout = compile_rollouts(compiled, policy, planner.horizon, rollouts, options)
    if stopping:
        rollout = stop_at_termination(rollout)
    start = jax.tree.map(partial(_repeat_first, count=rollouts), fluents)
    model = compiled.model_aux["params"]
    hyperparams = unit_hyperparams(planner)
    seen = observed_fluents(planner.rddl)
    discounts = planner.rddl.discount ** jnp.arange(planner.horizon)

    def play(key: Array, params: Any) -> tuple[Array, dict[str, Array]]:
        log, _ = rollout(key, params, hyperparams, start, nonfluents, model)
        states = {name: log["fluents"][name] for name in seen} if with_states else {}
        return jnp.sum(discounts * log["reward"], axis=-1), states

    return play


def _legal(policy: Callable[..., Any], compiled: Any, nonfluents: Any) -> Callable[..., Any]:
    """The policy, with the no-op where its action breaks a precondition.

    That is the first that the exact environment's referee tries.
    """
    holds, model = compiled._jax_preconditions(), compiled.model_aux["params"]
    noop = {name: compiled.init_values[name] for name in compiled.rddl.action_fluents}

    def legal_policy(key, params, hyperparams, step, fluents, history):
        actions = policy(key, params, hyperparams, step, fluents, history)
        no_errors = jnp.zeros((), jnp.int32)
        is_legal, *_ = holds(key, no_errors, {**fluents, **actions}, nonfluents, model)
        return {
            name: jnp.where(is_legal, action, jnp.asarray(noop[name], jnp.asarray(action).dtype))
            for name, action in actions.items()
        }

    return legal_policy


def _repeat_first(leaf: Any, count: int) -> Array:
    return jnp.repeat(leaf[:1], count, axis=0)
