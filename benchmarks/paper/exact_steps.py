"""The exact model one step at a time, with states and actions as vectors."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.start import initial_values, unit_hyperparams


class ExactSteps(NamedTuple):
    """The pieces that a learner without a model needs, for real actions.

    Attributes:
      start: the initial fluents.
      horizon: number of steps.
      discount: of the rewards.
      state_size: length of the state vector: the state fluents in JaxPlan's order.
      lower, upper: the actions' box [actions]; the action fluents in JaxPlan's order.
      observe: fluents -> state vector [state_size].
      step: key, fluents, action vector in its box -> fluents, reward.
      raw_action: policy parameters, state vector -> action vector before its box.
    """

    start: dict[str, Array]
    horizon: int
    discount: float
    state_size: int
    lower: np.ndarray
    upper: np.ndarray
    observe: Callable[[Any], Array]
    step: Callable[[Array, Any, Array], tuple[Any, Array]]
    raw_action: Callable[[Any, Array], Array]


def compile_exact_steps(planner: MDPOPlanner) -> ExactSteps:
    """Makes the exact model's steps out of a planner's test model.

    Args:
      planner: a planner of a deep reactive policy that clips its actions.

    Raises:
      ValueError: if an action is not real, or the problem ends before its horizon.
    """
    rddl, compiled = planner.rddl, planner.test_compiled
    if rddl.terminations or set(rddl.action_ranges.values()) != {"real"}:
        raise ValueError("exact steps are for real actions and problems without termination")
    fluents, nonfluents = initial_values(planner).test
    start = {name: jnp.asarray(value[0]) for name, value in fluents.items()}
    states = {name: np.shape(start[name]) for name in rddl.observ_fluents or rddl.state_fluents}
    actions = {name: np.shape(compiled.init_values[name]) for name in rddl.action_fluents}
    transition = compiled.compile_transition(check_constraints=False, cache_path_info=False)
    model, hyperparams = compiled.model_aux["params"], unit_hyperparams(planner)
    lower, upper = (_vector({n: planner.plan.bounds[n][i] for n in actions}) for i in range(2))

    def observe(fluents):
        return jnp.concatenate([jnp.ravel(fluents[name]).astype(float) for name in states])

    def step(key, fluents, action):
        fluents, log, _ = transition(key, _tree(action, actions), fluents, nonfluents, model)
        return fluents, log["reward"]

    def raw_action(params, observation):
        key = jnp.zeros(2, jnp.uint32)  # a net without bools draws nothing
        state = _tree(observation, states)
        raw = planner.raw_policy(key, params, hyperparams, 0, state, {})
        return jnp.concatenate([jnp.ravel(raw[name]) for name in actions])

    size = sum(int(np.prod(shape)) for shape in states.values())
    sizes = planner.horizon, rddl.discount, size
    return ExactSteps(start, *sizes, lower, upper, observe, step, raw_action)


def _vector(tree: dict[str, Any]) -> np.ndarray:
    return np.concatenate([np.ravel(value) for value in tree.values()]).astype(np.float32)


def _tree(vector: Array, shapes: dict[str, tuple[int, ...]]) -> dict[str, Array]:
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes.values()])
    parts = jnp.split(vector, ends[:-1])
    return {
        name: jnp.reshape(part, shape)
        for (name, shape), part in zip(shapes.items(), parts, strict=True)
    }
