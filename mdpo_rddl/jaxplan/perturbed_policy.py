"""A JaxPlan plan, opened up so that a perturbation can enter ahead of its projection."""

import copy
import logging
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jax import Array

from mdpo_rddl.actions import ActionKind, ActionSpec
from mdpo_rddl.jaxplan.upstream import JaxPlan
from mdpo_rddl.projection import perturb_and_project

logger = logging.getLogger(__name__)

PerturbedPolicy = Callable[..., dict[str, Array]]


def action_specs(plan: JaxPlan, rddl: Any) -> dict[str, ActionSpec]:
    """The action fluents that take noise, as a compiled plan bounds them.

    Bools under a concurrency limit (`max-nondef-actions` below their number) take none:
    JaxPlan enforces the limit on logits that no caller can reach.
    """
    limited = _bools_are_limited(rddl)
    specs = {}
    for name, values in rddl.action_fluents.items():
        prange = rddl.variable_ranges[name]
        shape = np.shape(values)
        if prange == "bool":
            if limited:
                logger.warning("no noise on %s: its number of true values is limited", name)
                continue
            nothing = np.full(shape, np.nan)
            specs[name] = ActionSpec(name, shape, ActionKind.BOOL, nothing, nothing)
            continue
        kind = ActionKind.REAL if prange == "real" else ActionKind.INTEGER
        lower, upper = (np.broadcast_to(bound, shape) for bound in plan.bounds[name])
        squashed = bool(getattr(plan, "_wrap_non_bool", False))
        specs[name] = ActionSpec(name, shape, kind, lower, upper, squashed)
    return specs


def _bools_are_limited(rddl: Any) -> bool:
    bools = sum(
        np.size(values)
        for name, values in rddl.action_fluents.items()
        if rddl.variable_ranges[name] == "bool"
    )
    return rddl.max_allowed_actions < bools


def copy_uncompiled(plan: JaxPlan) -> JaxPlan:
    """A second plan like `plan`, to be compiled apart from it.

    Compiling replaces a plan's initializer by a compiled function, so a plan that was
    compiled once cannot be compiled again.
    """
    return copy.copy(plan)


def compile_raw_policy(
    plan: JaxPlan, compiled: Any, horizon: int, preprocessor: Any
) -> Callable[..., dict[str, Array]]:
    """Compiles `plan` without bounds: its training policy then returns raw actions.

    Without bounds a plan that clips has nothing to clip to, and one that squashes applies
    the identity. Bools come out as probabilities.

    Args:
      plan: an uncompiled plan; it is consumed.
      compiled: JaxPlan's compiled relaxed model.
      horizon: number of steps H.
      preprocessor: JaxPlan's compiled preprocessor, or None.
    """
    rddl = compiled.rddl
    unbounded = {}
    for name, values in rddl.action_fluents.items():
        if rddl.variable_ranges[name] != "bool":
            shape = np.shape(values)
            unbounded[name] = (np.full(shape, -np.inf), np.full(shape, np.inf))
    warned, compiled.print_warnings = compiled.print_warnings, False
    try:
        plan.compile(compiled, _bounds=unbounded, horizon=horizon, preprocessor=preprocessor)
    finally:
        compiled.print_warnings = warned
    return plan.train_policy


def perturbed_policy(
    raw_policy: Callable[..., dict[str, Array]], specs: Mapping[str, ActionSpec]
) -> PerturbedPolicy:
    """`raw_policy` with one more argument, the step's perturbation per fluent [*shape]."""

    def policy(key, params, hyperparams, step, fluents, history, perturbation):
        raw = raw_policy(key, params, hyperparams, step, fluents, history)
        return perturb_and_project(raw, perturbation, specs)

    return policy
