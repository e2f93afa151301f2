"""A policy of the tiger problem that only listens."""

import functools

import jax
import numpy as np

from helpers.lakes import preset
from helpers.toys import toy
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.policy.policy import Compiled, Policy

NOTHING_SHOWN = {"growl-left": np.array(None)}


@functools.cache
def listener():
    """A policy that listens, whatever it hears, and remembers."""
    config = preset(1.0).without_section("Search")
    memory = {"observations": [1.0], "actions": [1.0]}
    config = config.with_policy_arguments(topology=[], plan=False, memory=memory)
    problem = toy("tiger")
    planner = build_planner(problem, config).planner
    params = jax.tree.map(np.zeros_like, planner.plan.initializer(jax.random.PRNGKey(0), {}, None))
    biases = {name: {**own, "bias": np.float32(-4.0)} for name, own in params["own"].items()}
    return Policy(
        problem, config, {**params, "own": biases}, {}, seed=0, compiled=Compiled(planner)
    )
