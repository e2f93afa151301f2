"""A policy of the umbrella problem that never takes it, and one that votes."""

import dataclasses
import functools

import jax
import numpy as np

from helpers.lakes import preset
from helpers.toys import toy
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.policy.policy import Compiled, Policy
from mdpo_rddl.problem.underlying import underlying_mdp

NOTHING_SHOWN = {"patter": np.array(None)}


def pattering(is_heard):
    return {"patter": np.bool_(is_heard)}


@functools.cache
def careless() -> Policy:
    """Never takes the umbrella, and remembers nothing."""
    config = preset(1.0).without_section("Search").with_policy_arguments(topology=[], plan=False)
    problem = toy("umbrella")
    planner = build_planner(problem, config).planner
    params = jax.tree.map(np.zeros_like, planner.plan.initializer(jax.random.PRNGKey(0), {}, None))
    biases = {name: {**own, "bias": np.float32(-4.0)} for name, own in params["own"].items()}
    return Policy(
        problem, config, {**params, "own": biases}, {}, seed=0, compiled=Compiled(planner)
    )


@functools.cache
def voting() -> Policy:
    """Takes it where most particles say that it is wet."""
    solution = find_optimum(underlying_mdp(toy("umbrella")), 60.0)
    assert solution.value == 20.0
    saved = solution.policy().to_saved()
    return dataclasses.replace(careless(), saved_underlying=saved, votes=True)


def wet(heard) -> list[float]:
    """How likely it is wet at each step, by Bayes' rule, after what was heard from step 1 on."""
    likely = [0.0]
    for is_heard in heard:
        after = 0.8 * likely[-1] + 0.3 * (1.0 - likely[-1])
        rain, dry = (0.75, 0.1) if is_heard else (0.25, 0.9)
        likely.append(rain * after / (rain * after + dry * (1.0 - after)))
    return likely
