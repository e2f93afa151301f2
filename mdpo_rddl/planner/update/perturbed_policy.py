"""A JaxPlan plan, opened up so that a perturbation can enter ahead of its projection."""

import contextlib
import copy
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from jax import Array

from mdpo_rddl.noise.actions import ActionKind, ActionSpec
from mdpo_rddl.noise.projection import perturb_and_project
from mdpo_rddl.planner.plans.limits import choose_within_limits, scale_to_limits
from mdpo_rddl.planner.plans.opened import open_plan
from mdpo_rddl.planner.upstream import JaxPlan
from mdpo_rddl.problem.limits import GroupLimit, limited_bools

logger = logging.getLogger(__name__)

PerturbedPolicy = Callable[..., dict[str, Array]]


def action_specs(
    plan: JaxPlan, compiled: Any, user_bounds: Mapping[str, Any]
) -> dict[str, ActionSpec]:
    """The action fluents that take noise, as a compiled plan bounds them.

    Bools whose number `max-nondef-actions` limits take none under a plan that is neither of
    JaxPlan's own, since only those say where their logits are.

    Args:
      plan: the compiled plan; one that does not tell its bounds has the model's boxes.
      compiled: JaxPlan's compiled relaxed model.
      user_bounds: boxes that replace those of the model, by the action fluent's name.
    """
    rddl, bounds = compiled.rddl, getattr(plan, "bounds", None)
    if bounds is None:
        with _without_warnings(compiled):
            _, bounds, *_ = plan._calculate_action_info(compiled, user_bounds, 1)
    limited, opened = limited_bools(rddl), open_plan(plan)
    specs = {}
    for name in rddl.action_fluents:
        prange = rddl.variable_ranges[name]
        shape = np.shape(compiled.init_values[name])
        if prange == "bool":
            kind = ActionKind.BOOL
            if name in limited:
                if opened.shift_for(limited) is None:
                    logger.warning("no noise on %s: unknown kind of plan", name)
                    continue
                kind = ActionKind.CHOICE if opened.is_softmax else ActionKind.BOOL
            no_box = np.full(shape, np.nan)
            specs[name] = ActionSpec(name, shape, kind, no_box, no_box)
            continue
        kind = ActionKind.REAL if prange == "real" else ActionKind.INTEGER
        lower, upper = (np.broadcast_to(bound, shape) for bound in bounds[name])
        unit = np.asarray(opened.units.get(name, 1.0))
        specs[name] = ActionSpec(name, shape, kind, lower, upper, opened.squashes, unit)
    return specs


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
    for name in rddl.action_fluents:
        if rddl.variable_ranges[name] != "bool":
            shape = np.shape(compiled.init_values[name])
            unbounded[name] = (np.full(shape, -np.inf), np.full(shape, np.inf))
    with _without_warnings(compiled):
        plan.compile(compiled, _bounds=unbounded, horizon=horizon, preprocessor=preprocessor)
    return plan.train_policy


@contextlib.contextmanager
def _without_warnings(compiled: Any) -> Iterator[None]:
    """JaxPlan prints an action's bounds whenever it works them out."""
    warned, compiled.print_warnings = compiled.print_warnings, False
    try:
        yield
    finally:
        compiled.print_warnings = warned


def perturbed_policy(
    raw_policy: Callable[..., dict[str, Array]],
    plan: JaxPlan,
    rddl: Any,
    specs: Mapping[str, ActionSpec],
    limits: Sequence[GroupLimit],
    perturb: Callable[..., dict[str, Array]] = perturb_and_project,
) -> PerturbedPolicy:
    """`raw_policy` with one more argument, the step's perturbation per fluent [*shape].

    Args:
      raw_policy: the plan's policy without a box.
      plan: the compiled plan.
      rddl: pyRDDLGym's lifted model.
      specs: the fluents that take noise.
      limits: the groups of bools of which few may be true.
      perturb: how raw action, perturbation and box become an action.
    """
    limited = [name for name in limited_bools(rddl) if name in specs]
    shift_limited = open_plan(plan).shift_for(limited) if limited else None

    def policy(*arguments):
        key, params, hyperparams, step, fluents, history, perturbation = arguments
        if shift_limited is not None:
            params, step = shift_limited(params, hyperparams, step, perturbation)
        raw = raw_policy(key, params, hyperparams, step, fluents, history)
        rest = {name: value for name, value in perturbation.items() if name not in limited}
        return scale_to_limits(perturb(raw, rest, specs), limits)

    return policy


def limited_policies(
    plan: JaxPlan, limits: Sequence[GroupLimit]
) -> tuple[Callable[..., dict[str, Array]], Callable[..., dict[str, Array]]]:
    """A compiled plan's training and test policies, made to keep the groups' limits."""
    train_policy, test_policy = plan.train_policy, plan.test_policy
    opened = open_plan(plan)
    # a plan's own limit on all bools must hold together with the groups'
    every = [*limits, *opened.concurrency]
    names = sorted({name for limit in every for name in limit.groups})
    probabilities_of = opened.probabilities

    def train(*arguments):
        return scale_to_limits(train_policy(*arguments), limits)

    def test(*arguments):
        probabilities = probabilities_of(*arguments)
        grouped = {name: probabilities[name] for name in names}
        return {**test_policy(*arguments), **choose_within_limits(grouped, every)}

    return train, test
