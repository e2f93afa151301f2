"""Rollouts of the stochastic policy on the exact model, with what it saw and what it drew."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array, random

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.features import observed_fluents
from mdpo_rddl.planner.policy_gradient.actor import Actor
from mdpo_rddl.planner.rollouts.compiled import PerturbedModel, RolloutOptions, compile_rollouts
from mdpo_rddl.planner.rollouts.termination import steps_alive
from mdpo_rddl.planner.start import initial_values, repeated, unit_hyperparams

_NOISE = "noise"


class Rollouts(NamedTuple):
    """B rollouts of H steps.

    Attributes:
      states: per observed fluent its values before each step [B, H, *shape].
      noise: of which the law's proposals are drawn [B, H, ...].
      rewards: of each step, zero after the end of the episode [B, H].
      alive: 1 up to the step that ends the episode, 0 after it [B, H].
    """

    states: dict[str, Array]
    noise: Array
    rewards: Array
    alive: Array


def compile_drawn_rollouts(
    planner: MDPOPlanner, actor: Actor, rollouts: int
) -> Callable[[Array, Any], Rollouts]:
    """Compiles rollouts under the exact environment's rules.

    Args:
      planner: compiled, with a `FeedbackPlan`.
      actor: what is played.
      rollouts: how many, B.

    Returns:
      A function of a random key and parameters of the feedback policy.
    """

    def policy(key, params, hyperparams, step, state, *rest):
        del key, hyperparams
        return actor.act(params, state, step, rest[-1][_NOISE])

    compiled, horizon = planner.test_compiled, planner.horizon
    options = RolloutOptions(check_constraints=True, cache_path_info=True, differentiated=False)
    rollout = compile_rollouts(compiled, policy, horizon, rollouts, options)
    fluents, nonfluents = initial_values(planner).test
    start = repeated(fluents, rollouts)
    model, hyperparams = compiled.model_aux["params"], unit_hyperparams(planner)
    seen = observed_fluents(planner.rddl)

    def play(key: Array, params: Any) -> Rollouts:
        drawing, playing = random.split(key)
        noise = actor.law.noise(drawing, (rollouts, horizon))
        perturbed = PerturbedModel(model, {_NOISE: noise})
        log, _ = rollout(playing, params, hyperparams, start, nonfluents, perturbed)
        alive = steps_alive(log["termination"] | ~log["invariant"])
        # the log has the states after each step
        states = {
            name: jnp.concatenate([start[name][:, jnp.newaxis], log["fluents"][name][:, :-1]], 1)
            for name in seen
        }
        return Rollouts(states, noise, jnp.where(alive > 0.0, log["reward"], 0.0), alive)

    return play
