"""Rollouts of the greedy policy on the exact model, some of which try other actions."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array, lax, random

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.greedy_plan import GreedyPlan
from mdpo_rddl.planner.plans.legal import compile_playable
from mdpo_rddl.planner.programs.staging import with_fast_random_numbers
from mdpo_rddl.planner.rollouts.compiled import PerturbedModel, RolloutOptions, compile_rollouts
from mdpo_rddl.planner.rollouts.termination import steps_alive
from mdpo_rddl.planner.start import initial_values, repeated, unit_hyperparams

# of what is tried, with which it goes on at the next step: what leads somewhere takes several; and
# with which a component leaves the no-op rather than staying there
_LASTS, _LEAVES = 0.75, 0.75
_TINY = 1e-6


class Trying(NamedTuple):
    """What is tried beside the greedy policy's actions.

    Attributes:
      is_guided: whether the other policy plays, for each rollout [B].
      share: of the steps at which one change is decided at random, for each rollout [B].
    """

    is_guided: Array
    share: Array


class Explored(NamedTuple):
    """B rollouts of H steps.

    Attributes:
      states: per state fluent its values before each step [B, H, *shape].
      rewards: of each step, zero after the end of the episode [B, H]; at a step at which no legal
        action is found, which ends it, so much less than any legal one that no return makes up
        for it.
      alive: 1 up to the step that ends the episode, 0 after it [B, H].
      is_tried: whether one change was decided at random at a step [B, H].
      lost: share of the steps from that on at which no legal action is found [B].
    """

    states: dict[str, Array]
    rewards: Array
    alive: Array
    is_tried: Array
    lost: Array


def compile_exploring(
    planner: MDPOPlanner, guide: FeedbackPlan, rollouts: int
) -> Callable[[tuple[Array, Array], Any, Any, Trying], Explored]:
    """Compiles rollouts under the exact environment's rules.

    Args:
      planner: compiled, with a `GreedyPlan`.
      guide: a compiled feedback policy of the same problem, which plays where it is asked for.
      rollouts: how many, B.

    Returns:
      A function of two random keys, of the rollouts and of what is tried; weights of the value;
      parameters of the feedback policy; and what is tried.
    """
    plan, horizon = planner.plan, planner.horizon
    assert isinstance(plan, GreedyPlan)

    def policy(key, params, hyperparams, step, state, *rest):
        del hyperparams
        weights, guiding = params
        given = rest[-1]
        other = plan.changes.like(guide.proposed(guiding, state, step))
        # more samples than these would leave fewer iterations
        own = plan.gains(weights, key, state, step, plan.rollout_samples)
        gains = jnp.where(given["guided"], other, own)
        tried = _with_one_forced(gains, given["place"], given["leaves"])
        return plan.choose(jnp.where(given["tried"], tried, gains), state)

    compiled = planner.test_compiled
    options = RolloutOptions(
        check_constraints=True,
        cache_path_info=True,
        differentiated=False,
        playable=compile_playable(compiled),
    )
    rollout = compile_rollouts(compiled, policy, horizon, rollouts, options)
    fluents, nonfluents = initial_values(planner).test
    start = repeated(fluents, rollouts)
    model, hyperparams = compiled.model_aux["params"], unit_hyperparams(planner)
    shape = rollouts, horizon

    def play(keys: tuple[Array, Array], weights: Any, guiding: Any, trying: Trying) -> Explored:
        playing, drawing = keys
        # one draw: each would have kernels of its own, which take long to compile
        drawn = with_fast_random_numbers(lambda key: random.uniform(key, (4, *shape)))(drawing)
        deciding, renewing = drawn[:2]
        last = _last_renewals(renewing >= _LASTS)
        place, sign = jnp.take_along_axis(drawn[2:], last[jnp.newaxis], axis=2)
        given = {
            "guided": jnp.broadcast_to(trying.is_guided[:, jnp.newaxis], shape),
            "leaves": sign < _LEAVES,
            "place": jnp.asarray(place * (plan.size + 1), int),
            "tried": deciding < trying.share[:, jnp.newaxis],
        }
        perturbed = PerturbedModel(model, given)
        log, _ = rollout(playing, (weights, guiding), hyperparams, start, nonfluents, perturbed)
        alive = steps_alive(log["termination"] | ~log["invariant"])
        # the log has the states after each step
        states = {
            name: jnp.concatenate([start[name][:, jnp.newaxis], log["fluents"][name][:, :-1]], 1)
            for name in planner.rddl.state_fluents
        }
        rewards = jnp.where(alive > 0.0, log["reward"], 0.0)
        lost = jnp.zeros(shape[0], rewards.dtype)
        if options.playable is not None:
            is_dead = ~log["playable"] & (alive > 0.0)
            is_lost = jnp.cumsum(is_dead, axis=1) > 0
            lost = jnp.mean(is_lost.astype(rewards.dtype), axis=1)
            alive = alive * steps_alive(is_dead)
            rewards = jnp.where(alive > 0.0, _with_dead_ends(rewards, is_dead), 0.0)
        return Explored(states, rewards, alive, given["tried"], lost)

    return play


def _with_dead_ends(rewards: Array, is_dead: Array) -> Array:
    """Rewards [B, H] of which those of dead ends cost all that an episode can return, and more."""
    most = jnp.max(jnp.where(is_dead, 0.0, jnp.abs(rewards)))
    cost = 2.0 * rewards.shape[1] * jnp.where(most > 0.0, most, 1.0)
    return jnp.where(is_dead, -cost, rewards)


def _with_one_forced(gains: Array, place: Array, leaves: Array) -> Array:
    """Gains [D] of which one says that its change is made or not, whatever it gains.

    Args:
      gains: of all changes [D].
      place: the number of that one, from 1; 0 for the no-op, of which no change is made.
      leaves: whether it is made.
    """
    most = 2.0 * jnp.max(jnp.abs(gains)) + _TINY
    forced = gains.at[place - 1].set(jnp.where(leaves, most, -most))
    return jnp.where(place == 0, -most, forced)


def _last_renewals(is_new: Array) -> Array:
    """At each step the last one up to it at which something is new [B, H]; 0 before the first."""
    return lax.cummax(jnp.where(is_new, jnp.arange(is_new.shape[1]), 0), axis=1)
