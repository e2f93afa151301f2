"""A policy that never acts, of the tiny problem with real actions."""

import functools

import jax
import numpy as np

from helpers.problems import TINY_DOMAIN, TINY_INSTANCE
from helpers.toys import problem_from
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.start import unit_hyperparams
from mdpo_rddl.policy.policy import Compiled, Policy


@functools.cache
def idle_policy(spread: float = 0.0) -> Policy:
    """Returns -0.5 a step: two units stay half a unit from their goals. The horizon is 4."""
    instance = TINY_INSTANCE.replace("_HORIZON", "4").replace("_SPREAD", str(spread))
    problem = problem_from(TINY_DOMAIN + instance)
    config = auto_preset("tiny").without_section("Search")
    planner = build_planner(problem, config).planner
    params = jax.tree.map(np.asarray, planner.plan.initializer(jax.random.PRNGKey(0), {}, None))
    return Policy(
        problem, config, params, unit_hyperparams(planner), seed=0, compiled=Compiled(planner)
    )
