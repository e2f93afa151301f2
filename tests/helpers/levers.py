"""The toy with three arms, and policies of it that always pull the same ones."""

import functools
from collections.abc import Sequence

import jax
import numpy as np

from helpers.toys import toy
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.start import unit_hyperparams
from mdpo_rddl.policy.policy import Compiled, Policy
from mdpo_rddl.problem.load import Problem

NONE = (0, 0, 0)


def lever_policy(pulled: Sequence[float] = NONE, **words: str) -> Policy:
    """A policy that pulls the same arms at every step; it pays 1, -2 and 3 to pull one.

    Args:
      pulled: per arm whether.
      **words: of the toy's file, in capitals, that are not to be as usual.
    """
    problem, config, planner = _compiled(tuple(sorted(words.items())))
    params = jax.tree.map(np.asarray, planner.plan.initializer(jax.random.PRNGKey(0), {}, None))
    bias = np.where(np.array(pulled) > 0, 4.0, -4.0).astype(np.float32)
    params["own"]["pull"] = {**params["own"]["pull"], "bias": bias}
    return Policy(
        problem, config, params, unit_hyperparams(planner), seed=0, compiled=Compiled(planner)
    )


@functools.cache
def _compiled(words: tuple[tuple[str, str], ...]) -> tuple[Problem, PlannerConfig, MDPOPlanner]:
    """One planner for all policies of the same problem."""
    usual = {"LIKELIHOOD": "1.0", "MOST": "pos-inf", "DISCOUNT": "1.0", "TERMINATION": "false"}
    rules = {"RULES": "forall_{?a : arm} [pull(?a) => true];"}
    problem = toy("lever", **{**usual, **rules, **dict(words)})
    config = auto_preset("lever").without_section("Search")
    return problem, config, build_planner(problem, config).planner
