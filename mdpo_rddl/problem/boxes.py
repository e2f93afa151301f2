"""The boxes of numeric actions that preconditions state, one ground action at a time.

pyRDDLGym's own reading assigns limits by the order of the `forall`s' variables: it transposes those
of `forall_{?y : y, ?x : x} [a(?x, ?y) <= M(?x, ?y)]`, takes `f(?x, ?x)` for all `f(?x, ?y)`, and
gives a fluent without parameters an array where its limit reads a variable.
"""

import warnings
from typing import Any

import numpy as np
from pyRDDLGym.core.compiler.model import RDDLLiftedModel
from pyRDDLGym.core.constraints import RDDLConstraints
from pyRDDLGym.core.simulator import RDDLSimulator

from mdpo_rddl.problem.intervals import with_reachable_bounds

Box = tuple[Any, Any]
"""Lower and upper bound [*shape], infinite where there is none."""


def boxes(simulator: RDDLSimulator) -> dict[str, Box]:
    """The box of each fluent that has one of its own.

    Those of integer actions hold what is legal in some state that legal actions reach, where
    preconditions read the state (`mdpo_rddl.problem.intervals`).

    Args:
      simulator: of the problem; only its non-fluents are read.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what is no box, which pyRDDLGym has said already
        found = dict(_Constraints(simulator, vectorized=True).bounds)
    return with_reachable_bounds(simulator, found)


def action_boxes(model: RDDLLiftedModel) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Lower and upper bound [*shape], infinite where there is none, of each action fluent."""
    found = boxes(RDDLSimulator(model))

    def bound(name: str, side: int) -> np.ndarray:
        shape = tuple(model.object_counts(model.variable_params[name]))
        return np.broadcast_to(np.asarray(found[name][side], float), shape)

    return {name: (bound(name, 0), bound(name, 1)) for name in model.action_fluents}


def box_width(lower: Any, upper: Any) -> float | None:
    """The median width of an action fluent's boxes; None if none of them is finite.

    One width for all objects, so that shared weights mean the same for each.
    """
    width = np.subtract(upper, lower, dtype=float)
    finite = width[np.isfinite(width) & (width > 0)]
    return float(np.median(finite)) if finite.size else None


class _Constraints(RDDLConstraints):
    """pyRDDLGym's, with limits in the order of the fluent's parameters."""

    def _parse_bounds_relational(self, tag: str, expr: Any, objects: Any, search_vars: Any) -> Any:
        found = super()._parse_bounds_relational(tag, expr, objects, search_vars)
        name, limit, place, slices = found
        if name is None or not objects:
            return found
        fluent = next(
            one for one in expr.args if one.is_pvariable_expression() and one.args[0] == name
        )
        variables = [variable for variable, _ in objects]
        free = [each for each in fluent.args[1] or [] if each in variables]
        limits = np.asarray(limit)
        # of one object in two places the others say nothing
        if len(set(free)) < len(free) or limits.ndim not in (0, len(variables)):
            return None, 0.0, None, []
        if limits.ndim:
            unused = tuple(axis for axis, each in enumerate(variables) if each not in free)
            limits = (np.min if place == 1 else np.max)(limits, axis=unused)
            kept = [each for each in variables if each in free]
            limits = np.transpose(limits, [kept.index(each) for each in free])
        return name, limits if limits.ndim else limits.item(), place, slices
