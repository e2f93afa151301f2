"""The states that a policy comes through."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.features import observed_fluents
from mdpo_rddl.planner.start import unit_hyperparams
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import Problem, make_environment
from mdpo_rddl.problem.observation import is_observed


class _States:
    """Keeps what is observed in an episode."""

    def __init__(self) -> None:
        self.seen: list[dict[str, Any]] = []

    def begin(self) -> "_States":
        """It is the recorder of its only episode."""
        return self

    def add(self, state: Mapping[str, Any], actions: Mapping[str, Any], reward: float) -> None:
        """Appends what was observed."""
        if all(is_observed(value) for value in state.values()):
            self.seen.append(dict(state))


def visited_states(problem: Problem, planner: MDPOPlanner, params: Any) -> dict[str, Array]:
    """What a policy sees in one episode on the exact environment, per fluent [T, *shape].

    Args:
      problem: what is played.
      planner: that the parameters belong to.
      params: of one policy.
    """
    states, hyperparams = _States(), unit_hyperparams(planner)
    policy = playable(planner, params, hyperparams, seed=0)
    evaluate(make_environment(problem), policy, episodes=1, seed=0, recorder=states)
    stacked = {}
    for name in observed_fluents(planner.rddl):
        # the environment gives a fluent without parameters as an array of one
        shape = np.shape(planner.compiled.init_values[name])
        values = [np.reshape(planner.numbers(name, s[name]), shape) for s in states.seen]
        stacked[name] = jnp.asarray(np.stack(values), planner.compiled.REAL)
    return stacked
