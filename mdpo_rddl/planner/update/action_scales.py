"""How large an action without a box must be for the return to answer."""

import logging
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, random

from mdpo_rddl.noise.actions import ActionSpec
from mdpo_rddl.noise.units import RANGE, has_box, in_range_units
from mdpo_rddl.planner.rollouts.compiled import RolloutOptions, compile_rollouts
from mdpo_rddl.planner.rollouts.termination import stop_at_termination
from mdpo_rddl.planner.start import initial_values

logger = logging.getLogger(__name__)

_POSITIVE = 10.0 ** np.arange(-3.0, 6.01, 0.5)
SIZES = np.concatenate([[0.0], _POSITIVE, -_POSITIVE])
"""Of the constant actions that are tried, the no-op first."""

# a constant action is better than the no-op if it gains so much of the no-op's return
_GAIN = 0.005
# and does no harm if it loses no more than that
_LOSS = 0.1
# a smaller difference is rounding
_ANSWER = 1e-6


def specs_in_unit(planner: Any, specs: Mapping[str, ActionSpec]) -> dict[str, ActionSpec]:
    """The action fluents in the unit of the planner's noise rule.

    Args:
      planner: with its models and its plan compiled.
      specs: the fluents that take noise, as the plan has them.
    """
    if planner.noise.unit != RANGE:
        return dict(specs)
    unbounded = [spec for spec in specs.values() if not has_box(spec)]
    return in_range_units(specs, _scales(planner, unbounded))


def _scales(planner: Any, specs: Sequence[ActionSpec]) -> dict[str, float]:
    """Per fluent the best constant action's size, or the largest that does no harm.

    The exact model is played from the initial state with one fluent constant, all its
    components the same, and the others at their no-op.
    """
    if not specs:
        return {}
    play = _constant_play(planner)
    values = planner.test_compiled.init_values
    noop = {name: jnp.asarray(values[name]) for name in planner.rddl.action_fluents}
    scales = {}
    for spec in specs:
        name = spec.name
        actions = {key: jnp.stack([value] * len(SIZES)) for key, value in noop.items()}
        shape = (-1,) + (1,) * noop[name].ndim
        constant = np.clip(noop[name] + SIZES.reshape(shape), spec.lower, spec.upper)
        actions[name] = jnp.asarray(constant, noop[name].dtype)
        returns = np.asarray(play(random.PRNGKey(0), actions), np.float64)
        scales[name] = answering_size(SIZES, np.where(np.isfinite(returns), returns, -np.inf))
        logger.info("noise on %s in units of %g", name, scales[name])
    return scales


def answering_size(sizes: np.ndarray, returns: np.ndarray) -> float:
    """The size of the best constant action where it beats none, else the largest harmless.

    Args:
      sizes: of the constant actions [N], the first one 0.
      returns: theirs [N], or [C, N] beside each of C constants of the other actions.

    Returns:
      The size; sizes to which the return does not answer are harmless only if there is no other,
      and then it is 1.
    """
    rows = np.atleast_2d(returns)
    none = rows[:, :1]
    margin = np.where(np.isfinite(none), np.abs(none), 0.0)
    with np.errstate(invalid="ignore"):
        answers = np.abs(rows - none) > _ANSWER * margin
    is_better = rows > none + _GAIN * margin
    if is_better.any():
        best = np.argmax(np.max(np.where(is_better, rows, -np.inf), axis=0))
        return float(abs(sizes[best]))
    if not answers.any():
        return 1.0
    harmless = (answers & (rows >= none - _LOSS * margin)).any(axis=0)
    return float(np.max(np.abs(sizes[harmless]), initial=_POSITIVE[0]))


def _constant_play(planner: Any) -> Any:
    """Compiles the exact return of constant actions [N, *shape] per fluent, one rollout each."""
    compiled = planner.test_compiled
    stopping = bool(planner.rddl.terminations or planner.rddl.invariants)
    rollout = compile_rollouts(
        compiled,
        lambda key, params, *rest: params,
        planner.horizon,
        1,
        RolloutOptions(check_constraints=stopping, differentiated=False),
    )
    if stopping:
        rollout = stop_at_termination(rollout)
    fluents, nonfluents = initial_values(planner).test
    start = jax.tree.map(lambda leaf: leaf[:1], fluents)
    discounts = planner.rddl.discount ** jnp.arange(planner.horizon)

    def play(key: Array, actions: dict[str, Array]) -> Array:
        model = compiled.model_aux["params"]
        log, _ = rollout(key, actions, {}, start, nonfluents, model)
        return jnp.sum(discounts * log["reward"][0])

    return jax.jit(jax.vmap(play, in_axes=(None, 0)))
