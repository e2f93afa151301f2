"""Rollouts of a compiled model that draw their random numbers ahead of the steps."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, core, lax, random

from mdpo_rddl.planner.model.expressions import Value
from mdpo_rddl.planner.programs.staging import Stages, with_fast_random_numbers
from mdpo_rddl.planner.rollouts.memory import bounded_scan
from mdpo_rddl.planner.rollouts.plan_memory import NO_MEMORY, PlanMemory, initial_memories

logger = logging.getLogger(__name__)

# of all rollouts together: more than that is drawn step by step
_AHEAD_BYTES = 2 * 10**8
_SHARED, _EARLY, _LATE = range(3)


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


@dataclass(frozen=True)
class RolloutOptions:
    """How rollouts are computed, and what they show.

    Attributes:
      copies: how many batches are vectorised together.
      history_dependent: whether the policy reads the fluents' history.
      check_constraints: whether the log tells preconditions, invariants and termination.
      cache_path_info: whether the log keeps every fluent at every step.
      differentiated: whether a gradient is taken, for which a large model keeps little.
      memory: what a policy that does not read the history remembers.
      playable: whether an action may be played, of the fluents with the actions' values and of the
        non-fluents; the log then tells it as `playable`.
    """

    copies: int = 1
    history_dependent: bool = False
    check_constraints: bool = False
    cache_path_info: bool = False
    differentiated: bool = True
    memory: PlanMemory = NO_MEMORY
    playable: Value | None = None


def compile_rollouts(
    compiled: Any,
    policy: Callable[..., dict[str, Array]],
    horizon: int,
    batch_size: int,
    options: RolloutOptions,
) -> Callable[..., tuple[dict[str, Any], Any]]:
    """Compiles rollouts with the arguments and results of JaxPlan's.

    The keys are JaxPlan's, so the rollout is the one that `JaxRDDLCompiler.compile_rollouts`
    makes, but for the order of floating-point operations. What depends on the keys and not on
    the state is computed for all steps at once, ahead of them, unless it is too large.

    Where the model parameters are a `PerturbedModel`, the policy's last argument is the step's
    perturbation. It is scanned over, which keeps its gradient linear in the horizon; as a policy
    hyperparameter its gradient would be accumulated whole at every step.

    Args:
      compiled: a model compiled by JaxPlan.
      policy: JaxPlan's policy, or a perturbed one.
      horizon: number of steps H.
      batch_size: rollouts B; for a perturbed policy that of the perturbation.
      options: how they are computed and what they show.

    Returns:
      rollout(key, policy_params, policy_hyperparams, fluents, nonfluents, model), with a
      leading batch axis B on the fluents, giving JaxPlan's log [B, H, ...] and the model
      parameters.
    """
    transition = _transition(compiled, options)

    def step(shared, early, late, known):
        hyperparams, nonfluents, model = shared
        nonfluents = {**nonfluents, **known}
        key, number, extra = early
        params, (fluents, memory), history = late
        key, model_key = random.split(key)
        past = history if options.history_dependent else memory
        actions = policy(key, params, hyperparams, number, fluents, past, *extra)
        after, log, model = transition(model_key, actions, fluents, nonfluents, model)
        memory = options.memory.update(memory, number, fluents, actions)
        return (after, memory), log, model

    def rollout(key, params, hyperparams, fluents, nonfluents, model):
        extra, size = (), batch_size
        if isinstance(model, PerturbedModel):
            size = jax.tree.leaves(model.perturbation)[0].shape[0]
            extra = (jax.tree.map(lambda p: jnp.swapaxes(p, 0, 1), model.perturbation),)
            model = model.params
        history = _empty_history(fluents, horizon) if options.history_dependent else {}
        memory = initial_memories(options.memory, size)

        # what relations there are is read off constants
        known = {n: v for n, v in nonfluents.items() if not isinstance(v, core.Tracer)}
        others = {name: v for name, v in nonfluents.items() if name not in known}
        shared = (hyperparams, others, model)
        early = (_step_keys(key, horizon, size), jnp.arange(horizon), extra)
        stages = Stages(
            partial(step, known=known),
            shared,
            (early[0][0, 0], early[1][0], jax.tree.map(lambda e: e[0, 0], extra)),
            (params, _one((fluents, memory), axis=0), _one(history, axis=1)),
        )
        passes = stages.passes_through()
        if not all(passes[len(passes) - len(jax.tree.leaves(model)) :]):
            raise NotImplementedError("the model's parameters change from step to step")
        common = stages.run(_SHARED, [], shared)
        ahead = _can_draw_ahead(stages, horizon * size * options.copies)
        draw = jax.vmap(lambda *early: stages.run(_EARLY, [common], early), in_axes=(0, None, 0))
        inputs = (jax.vmap(draw)(*early) if ahead else early, jnp.arange(horizon))

        @partial(jax.vmap, in_axes=(0, 0, 1))
        def late_step(drawn, state, history):
            state, log, _ = stages.run(_LATE, [common, drawn], (params, state, history))
            return state, log

        def scanned_step(carry, inputs):
            state, history = carry
            drawn, number = inputs
            if options.history_dependent:
                history = jax.tree.map(
                    lambda past, now: past.at[number].set(now), history, state[0]
                )
            state, log = late_step(drawn if ahead else draw(*drawn), state, history)
            return (state, history), log

        start = ((fluents, memory), history)
        if options.differentiated:
            end, log = bounded_scan(scanned_step, start, inputs, options.copies)
        else:
            end, log = lax.scan(scanned_step, start, inputs)
        log = jax.tree.map(lambda leaf: jnp.swapaxes(leaf, 0, 1), log)
        if not log["fluents"]:
            # JaxPlan's critic reads the last state even where no path is kept
            log["fluents"] = {name: value[:, jnp.newaxis] for name, value in end[0][0].items()}
        return log, model

    return rollout


def _transition(compiled: Any, options: RolloutOptions) -> Callable[..., tuple[Any, Any, Any]]:
    """JaxPlan's transition, which checks actions if that is wanted."""
    transition = compiled.compile_transition(
        check_constraints=options.check_constraints, cache_path_info=options.cache_path_info
    )
    playable = options.playable
    if playable is None:
        return transition

    def telling(key, actions, fluents, nonfluents, model):
        after, log, params = transition(key, actions, fluents, nonfluents, model)
        told = playable({**fluents, **actions}, nonfluents)
        return after, {**log, "playable": told}, params

    return telling


def _empty_history(fluents: Any, horizon: int) -> Any:
    return jax.tree.map(lambda f: jnp.zeros((horizon, *f.shape), f.dtype), fluents)


def _one(batched: Any, axis: int) -> Any:
    """The first rollout of a batch."""
    return jax.tree.map(lambda leaf: jnp.take(leaf, 0, axis), batched)


def _step_keys(key: Array, horizon: int, size: int) -> Array:
    """JaxPlan's keys of each step and rollout [H, B, 2]."""

    split_fast = with_fast_random_numbers(lambda key: random.split(key, 1 + size))

    def split(key, _):
        keys = split_fast(key)
        return keys[0], keys[1:]

    return lax.scan(split, key, None, length=horizon)[1]


def _can_draw_ahead(stages: Stages, times: int) -> bool:
    kept = stages.residual_types[_EARLY]
    size = times * sum(int(np.prod(leaf.shape)) * leaf.dtype.itemsize for leaf in kept)
    if size > _AHEAD_BYTES:
        logger.info("large model: %.0f MB of random numbers are drawn step by step", size / 1e6)
    return size <= _AHEAD_BYTES
