"""Training with JaxPlan's own planner, unmodified, as the baseline of a measurement."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np

from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.upstream import JaxBackpropPlanner


class TrainedBaseline(NamedTuple):
    """A planner of JaxPlan's with the best parameters by its own judgement, as numpy arrays."""

    planner: JaxBackpropPlanner
    params: Any
    policy_hyperparams: dict[str, Any]
    iterations: int


def train_baseline(
    built: Built[JaxBackpropPlanner],
    key: Any,
    budget: Budget | None = None,
    *,
    counts_compilation: bool = False,
    on_iteration: Callable[[Mapping[str, Any]], None] = lambda callback: None,
) -> TrainedBaseline:
    """Trains `JaxBackpropPlanner` with its own loop.

    Args:
      built: JaxPlan's planner.
      key: JAX random key.
      budget: where it ends; as configured if None.
      counts_compilation: whether compilation is part of the time.
      on_iteration: called with JaxPlan's callback of each iteration; what it raises ends the
        training.
    """
    budget = budget or built.budget
    # JaxPlan divides by epochs - 1
    for_jaxplan = Budget(max(2, budget.iterations), budget.seconds)
    if not counts_compilation:
        first = built.callbacks(key, for_jaxplan)
        next(first)
        first.close()
    callback: Mapping[str, Any] = {}
    for callback in built.callbacks(key, for_jaxplan):
        on_iteration(callback)
        if callback["iteration"] + 1 >= budget.iterations:
            break
    trees = callback["best_params"], dict(callback["policy_hyperparams"])
    params, hyperparams = jax.tree.map(np.asarray, trees)
    return TrainedBaseline(built.planner, params, hyperparams, callback["iteration"] + 1)
