"""Action preconditions that limit how many of a group of bools may be true.

JaxPlan reads boxes and `max-nondef-actions` and nothing else. RecSim's rule, for one,

    forall_{?c : consumer} [(sum_{?i : item} recommend(?c, ?i)) <= 1]

puts the bools of every consumer in a group of which at most one may be true.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mdpo_rddl.problem.implications import is_box


@dataclass(frozen=True)
class GroupLimit:
    """One precondition: disjoint groups of bools, each with the same kind of limit.

    Attributes:
      groups: per bool fluent, the group of each of its components [*shape], -1 for none.
      limits: largest number of true components of each group [G].
      exact: whether exactly that many must be true.
    """

    groups: Mapping[str, np.ndarray]
    limits: np.ndarray
    exact: bool = False


def group_limits(rddl: Any) -> tuple[list[GroupLimit], int]:
    """Finds the preconditions of that form in a problem.

    A precondition counts if it compares, perhaps under `forall`s, a sum of bool action
    fluents (each indexed by every variable of the `forall`s, and by each variable once) by
    `<=`, `<` or `==` to a number or a non-fluent.

    Args:
      rddl: pyRDDLGym's lifted model.

    Returns:
      The limits, and how many preconditions are neither of this form nor a box.
    """
    found, others = [], 0
    for precondition in rddl.preconditions:
        try:
            found.append(_read(rddl, precondition))
        except _NotALimitError:
            others += not is_box(rddl, precondition)
    return found, others


def limited_bools(rddl: Any) -> list[str]:
    """The bool action fluents, in JaxPlan's order, if their number of true values is limited."""
    names = [
        name
        for name, prange in rddl.variable_ranges.items()
        if rddl.variable_types[name] == "action-fluent" and prange == "bool"
    ]
    count = sum(np.size(rddl.action_fluents[name]) for name in names)
    return names if rddl.max_allowed_actions < count else []


def concurrency_limits(rddl: Any, shapes: Mapping[str, tuple[int, ...]]) -> list[GroupLimit]:
    """`max-nondef-actions` as a limit on one group of bools, if it limits anything."""
    names = limited_bools(rddl)
    if not names:
        return []
    groups = {name: np.zeros(shapes[name], dtype=int) for name in names}
    return [GroupLimit(groups, np.array([rddl.max_allowed_actions]))]


class _NotALimitError(Exception):
    """The precondition has another form."""


def _read(rddl: Any, expression: Any) -> GroupLimit:
    variables: dict[str, str] = {}
    while expression.etype == ("aggregation", "forall"):
        *typed, expression = expression.args
        variables |= dict(variable for _, variable in typed)
    kind, operator = expression.etype
    if kind != "relational":
        raise _NotALimitError
    left, right = expression.args
    if operator in (">=", ">"):
        left, right, operator = right, left, {">=": "<=", ">": "<"}[operator]
    if operator not in ("<=", "<", "=="):
        raise _NotALimitError
    groups: dict[str, np.ndarray] = {}
    _collect(rddl, left, variables, {}, groups)
    sizes = [len(rddl.type_to_objects[kind]) for kind in variables.values()]
    limits = np.broadcast_to(_number(rddl, right, list(variables)), sizes).ravel()
    if operator == "<":
        limits = np.ceil(limits) - 1
    limits = np.floor(limits).astype(int)
    if np.any(limits < 0):
        raise _NotALimitError
    return GroupLimit(groups, limits, exact=operator == "==")


def _collect(
    rddl: Any,
    expression: Any,
    free: Mapping[str, str],
    summed: Mapping[str, str],
    groups: dict[str, np.ndarray],
) -> None:
    """Adds the components that a sum of bool action fluents counts to `groups`."""
    if expression.etype == ("aggregation", "sum"):
        *typed, body = expression.args
        inner = dict(variable for _, variable in typed)
        _collect(rddl, body, free, {**summed, **inner}, groups)
    elif expression.etype == ("arithmetic", "+"):
        for argument in expression.args:
            _collect(rddl, argument, free, summed, groups)
    elif expression.etype[0] == "pvar":
        name, arguments = expression.args
        arguments = arguments or []
        is_bool_action = name in rddl.action_fluents and rddl.variable_ranges[name] == "bool"
        if not is_bool_action or name in groups:
            raise _NotALimitError
        # each variable once, no constant object: then every component is counted once
        if sorted(map(str, arguments)) != sorted([*free, *summed]):
            raise _NotALimitError
        shape = tuple(len(rddl.type_to_objects[kind]) for kind in rddl.variable_params[name])
        places = np.indices(shape) if shape else np.zeros((0,))
        group = np.zeros(shape, dtype=int)
        for variable, kind in free.items():
            size = len(rddl.type_to_objects[kind])
            group = group * size + places[arguments.index(variable)]
        groups[name] = group
    else:
        raise _NotALimitError


def _number(rddl: Any, expression: Any, free: Sequence[str]) -> Any:
    """A number or non-fluent, as an array that broadcasts over the free variables."""
    if expression.etype[0] == "constant":
        return expression.args
    if expression.etype[0] != "pvar":
        raise _NotALimitError
    name, arguments = expression.args
    arguments = list(arguments or [])
    if name not in rddl.non_fluents or arguments not in ([], list(free)):
        raise _NotALimitError
    shape = tuple(len(rddl.type_to_objects[kind]) for kind in rddl.variable_params[name])
    return np.reshape(rddl.non_fluents[name], shape)
