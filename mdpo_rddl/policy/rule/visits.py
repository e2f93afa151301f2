"""The states that a policy comes through."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.start import unit_hyperparams
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.episode import WatchedPolicy
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import Problem, make_environment
from mdpo_rddl.problem.observation import is_observed


def visited_states(problem: Problem, planner: MDPOPlanner, params: Any) -> dict[str, Array]:
    """What a policy sees in one episode on the exact environment, per fluent [T, *shape].

    The entries of the policy's memory are among them. There are none where the episode is over
    before anything is observed.

    Args:
      problem: what is played.
      planner: that the parameters belong to.
      params: of one policy.
    """
    play, seen = playable(planner, params, unit_hyperparams(planner), seed=0), []

    def policy(step: int, state: Mapping[str, Any]) -> Mapping[str, Any]:
        if all(is_observed(value) for value in state.values()):
            seen.append({**state, **play.memory_at(step)})
        return play(step, state)

    evaluate(make_environment(problem), WatchedPolicy(play, policy), episodes=1, seed=0)
    stacked: dict[str, Array] = {}
    if not seen:
        return stacked
    for name in planner.feedback_plan.feedback.seen:
        # the environment gives a fluent without parameters as an array of one
        shape = planner.feedback_plan.feedback.shapes[name]
        values = [np.reshape(planner.numbers(name, each[name]), shape) for each in seen]
        stacked[name] = jnp.asarray(np.stack(values), planner.compiled.REAL)
    return stacked
