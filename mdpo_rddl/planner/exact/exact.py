"""Many policies side by side on the exact model, compiled: no relaxation, no gradient."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, dtypes, lax

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.features import observed_fluents
from mdpo_rddl.planner.plans.legal import compile_playable
from mdpo_rddl.planner.plans.opened import open_plan
from mdpo_rddl.planner.programs.quick import Jit, light_jit
from mdpo_rddl.planner.rollouts.compiled import RolloutOptions, compile_rollouts
from mdpo_rddl.planner.rollouts.termination import stop_at_termination
from mdpo_rddl.planner.start import initial_values, repeated, unit_hyperparams
from mdpo_rddl.planner.upstream import INVALID_PARAMETERS
from mdpo_rddl.problem.evaluation import LOST, lost_worth


class Visits(NamedTuple):
    """What policies have returned and seen.

    Attributes:
      returns: discounted [P, N].
      states: per observed fluent its values after each step [P, N, H, *shape].
    """

    returns: Array
    states: dict[str, Array]


def compile_exact_returns(
    planner: MDPOPlanner, rollouts: int, side_by_side: int | None = None
) -> Callable[[Array, Any], Array]:
    """Compiles rollouts of the planner's policy on the exact model.

    These are the exact environment's rules: no reward counts after a termination condition or a
    broken invariant has ended the episode, whatever the planner's own switch says, and an action
    that breaks a rule is replaced as in play (`mdpo_rddl.planner.plans.legal`). A rollout that
    comes to a state in which no legal action is found is lost there: it returns `lost_worth` of the
    share of its steps that are left. Where the planner has `lose_on_error`, a rollout in which a
    parameter of a distribution leaves its domain returns `LOST`, be it in a branch that is not
    taken, in which the environment may not look at it.

    Args:
      planner: the compiled planner.
      rollouts: number of rollouts N of each policy.
      side_by_side: policies that are computed at once; all if None.

    Returns:
      A function of a random key and parameters with a leading axis of policies [P, ...] that
      gives their discounted returns [P, N]; all see the same random numbers.
    """
    play = _compile_play(planner, rollouts, with_states=False)
    return _over_policies(lambda key, params: play(key, params).returns, side_by_side)


def exact_returns(planner: MDPOPlanner, rollouts: int) -> Callable[[Array, Any], Array]:
    """`compile_exact_returns`, compiled once for each planner and number of rollouts."""
    programs = planner.exact_programs
    if rollouts not in programs:
        programs[rollouts] = compile_exact_returns(planner, rollouts)
    return programs[rollouts]


def compile_visits(
    planner: MDPOPlanner,
    rollouts: int,
    side_by_side: int | None = None,
    jit: Jit = light_jit,
) -> Callable[[Array, Any], Visits]:
    """As `compile_exact_returns`, and what the policies saw.

    Args:
      planner: the compiled planner.
      rollouts: number of rollouts N of each policy.
      side_by_side: policies that are computed at once; all if None.
      jit: compiles it.
    """
    play = _compile_play(planner, rollouts, with_states=True)
    return _over_policies(play, side_by_side, jit)


def step_bytes(planner: MDPOPlanner) -> int:
    """What one rollout of a feedback policy holds at one step, about: fluents and features."""
    feedback = planner.feedback_plan.feedback
    real = jnp.dtype(planner.compiled.REAL).itemsize
    features = sum(
        len(feedback.names(name)) * math.prod(shape) * real
        for name, shape in feedback.action_shapes.items()
    )
    return fluent_bytes(planner) + features


def fluent_bytes(planner: MDPOPlanner) -> int:
    """What the fluents of one rollout take at one step."""
    fluents = initial_values(planner).test.fluents
    return sum(leaf[:1].nbytes for leaf in jax.tree.leaves(fluents))


def visit_bytes(planner: MDPOPlanner) -> int:
    """What the states take that one rollout has seen, as `compile_visits` gives them."""
    fluents = initial_values(planner).test.fluents
    seen = [fluents[name][:1] for name in observed_fluents(planner.rddl)]
    step = sum(values.size * dtypes.canonicalize_dtype(values.dtype).itemsize for values in seen)
    return max(1, planner.horizon * step)


def _over_policies(
    play: Callable[..., Any], side_by_side: int | None, jit: Jit = light_jit
) -> Callable[..., Any]:
    if side_by_side is None:
        return jit(jax.vmap(play, in_axes=(None, 0)))
    return jit(lambda key, params: lax.map(partial(play, key), params, batch_size=side_by_side))


def _compile_play(
    planner: MDPOPlanner, rollouts: int, with_states: bool
) -> Callable[[Array, Any], Visits]:
    compiled = planner.test_compiled
    stopping = bool(planner.rddl.terminations or planner.rddl.invariants)
    fluents, nonfluents = initial_values(planner).test
    options = RolloutOptions(
        check_constraints=stopping,
        cache_path_info=with_states,
        differentiated=False,
        memory=open_plan(planner.plan).memory,
        playable=compile_playable(compiled),
    )
    rollout = compile_rollouts(compiled, planner.legal_policy, planner.horizon, rollouts, options)
    if stopping:
        rollout = stop_at_termination(rollout)
    start = repeated(fluents, rollouts)
    ends_at_once = _ends_at_once(compiled)
    model = compiled.model_aux["params"]
    hyperparams = unit_hyperparams(planner)
    seen = observed_fluents(planner.rddl)
    discounts = (planner.rddl.discount ** np.arange(planner.horizon)).astype(compiled.REAL)

    def play(key: Array, params: Any) -> Visits:
        log, _ = rollout(key, params, hyperparams, start, nonfluents, model)
        states = {name: log["fluents"][name] for name in seen} if with_states else {}

        def total(rewards: Array) -> Array:
            summed = jnp.sum(discounts * rewards, axis=-1)
            if options.playable is not None:
                is_lost = jnp.cumsum(~log["playable"], axis=-1) > 0
                worth = lost_worth(jnp.mean(is_lost.astype(summed.dtype), axis=-1))
                summed = jnp.where(is_lost[..., -1], worth, summed)
            if planner.lose_on_error:
                has_error = jnp.any((log["error"] & INVALID_PARAMETERS) != 0, axis=-1)
                summed = jnp.where(has_error, LOST, summed)
            return jnp.zeros_like(summed) if ends_at_once else summed

        return Visits(total(log["reward"]), states)

    return play


def _ends_at_once(compiled: Any) -> bool:
    """Whether the initial state ends the episode: the environment then plays no step."""
    fluents, nonfluents = compiled.split_fluent_nonfluent(compiled.init_values)
    model, key = compiled.model_aux["params"], jax.random.PRNGKey(0)
    return any(bool(ends(fluents, nonfluents, model, key)[0]) for ends in compiled.terminations)
