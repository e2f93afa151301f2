"""The settings' exact models, to evaluate many policies on."""

import functools
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import random

from benchmarks.common.settings import load_setting
from benchmarks.paper.iterates import Iterate
from benchmarks.paper.methods import method_config
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.exact.returns import compile_returns
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.problem.load import Problem

_KEY = 1


class ExactProblem(NamedTuple):
    """A setting to evaluate policies on.

    Attributes:
      problem: the setting.
      planner: a planner that plays policies of the paper's net.
      returns: keys [S, 2] and parameters [S, ...] -> returns on the compiled model [S, B].
    """

    problem: Problem
    planner: MDPOPlanner
    returns: Callable[[Any, Any], Any]


@functools.lru_cache(maxsize=1)
def exact_problem(setting: str, rollouts: int, activation: str | None = None) -> ExactProblem:
    """Compiles a setting's exact model; the last one is remembered.

    Args:
      setting: its name.
      rollouts: of each policy, B.
      activation: of the net's units; the preset's if None.
    """
    problem = problem_of(setting)
    config = method_config(problem.domain_name, "deterministic", 1)
    config = config.with_values("Planner", batch_size_test=rollouts)
    if activation is not None:
        config = config.with_policy_arguments(activation=activation)
    planner = build_planner(problem, config).planner
    return ExactProblem(problem, planner, compile_returns(planner))


@functools.lru_cache(maxsize=1)
def problem_of(setting: str) -> Problem:
    """The problem of a setting; the last one is remembered."""
    return load_setting(setting)


def iterate_returns(
    setting: str, rollouts: int, iterates: Iterable[Iterate], activation: str | None = None
) -> np.ndarray:
    """Returns of every iterate, seed and rollout [C, S, B] on the exact compiled model.

    The random numbers of a rollout depend on the seed, the iteration and its place in the
    batch, and not on the method.
    """
    exact = exact_problem(setting, rollouts, activation)
    fold = jax.vmap(random.fold_in, (None, 0))
    found = []
    for iterate in iterates:
        seeds = np.arange(len(jax.tree.leaves(iterate.params)[0]))
        key = random.fold_in(random.PRNGKey(_KEY), iterate.iteration)
        found.append(np.asarray(exact.returns(fold(key, seeds), iterate.params)))
    return np.stack(found)
