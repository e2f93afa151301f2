"""Action preconditions that limit how many of a group of bools may be true.

JaxPlan reads boxes and `max-nondef-actions` and nothing else. RecSim's rule, for one,

    forall_{?c : consumer} [(sum_{?i : item} recommend(?c, ?i)) <= 1]

puts the bools of every consumer in a group of which at most one may be true.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array


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
            others += not _is_box(rddl, precondition)
    return found, others


def scale_to_limits(
    probabilities: Mapping[str, Array], limits: Sequence[GroupLimit]
) -> dict[str, Array]:
    """Scales relaxed bools [*shape] down so that each group's sum keeps its limit.

    The gradient passes through the scale. Groups within their limit stay as they are.
    """
    scaled = dict(probabilities)
    for limit in limits:
        totals = jnp.zeros(len(limit.limits))
        for name, group in limit.groups.items():
            totals = totals + _group_sums(scaled[name], group, len(limit.limits))
        maximum = jnp.asarray(limit.limits, totals.dtype)
        over = totals > maximum
        factor = jnp.where(over, maximum / jnp.where(over, totals, 1.0), 1.0)
        factor = jnp.append(factor, 1.0)  # index -1: the components of no group
        for name, group in limit.groups.items():
            scaled[name] = scaled[name] * factor[group].astype(scaled[name].dtype)
    return scaled


def choose_within_limits(
    probabilities: Mapping[str, Array], limits: Sequence[GroupLimit]
) -> dict[str, Array]:
    """Bool actions [*shape] that keep every limit: the likeliest of each group.

    A component is true if its probability is above 0.5 and it is among the group's
    `limit` likeliest; under an exact limit, if it is among them at all.
    """
    chosen = {name: value > 0.5 for name, value in probabilities.items()}
    allowed = {name: jnp.ones_like(value, bool) for name, value in probabilities.items()}
    for limit in limits:
        names = list(limit.groups)
        group = np.concatenate([np.ravel(limit.groups[name]) for name in names])
        values, picked, free = (
            jnp.concatenate([jnp.ravel(tree[name]) for name in names])
            for tree in (probabilities, chosen, allowed)
        )
        candidates = free & (picked | (limit.exact & (group >= 0)))
        # what is no candidate ranks last, so that it takes no place
        within = _are_largest(jnp.where(candidates, values, -1.0), group, limit.limits)
        picked, free = candidates & within, free & within
        start = 0
        for name in names:
            shape = jnp.shape(probabilities[name])
            part = slice(start, start + math.prod(shape))
            chosen[name] = jnp.reshape(picked[part], shape)
            allowed[name] = jnp.reshape(free[part], shape)
            start = part.stop
    return chosen


def _group_sums(values: Array, group: np.ndarray, count: int) -> Array:
    ids = np.where(group < 0, count, group)
    return jax.ops.segment_sum(jnp.ravel(values), np.ravel(ids), count + 1)[:count]


def _are_largest(values: Array, group: np.ndarray, limits: np.ndarray) -> Array:
    """Whether each value is among the `limit` largest of its group [n]; ties by position.

    Values in no group are.
    """
    members = _members(group, len(limits))
    places = int(np.clip(np.max(limits), 1, members.shape[1]))
    padded = jnp.append(values, -jnp.inf)
    _, top = jax.lax.top_k(padded[members], places)
    largest = jnp.take_along_axis(jnp.asarray(members), top, axis=1)
    is_within = np.arange(places) < limits[:, np.newaxis]
    chosen = jnp.zeros(len(values) + 1, bool).at[largest].max(is_within)
    return chosen[:-1] | (group < 0)


def _members(group: np.ndarray, count: int) -> np.ndarray:
    """The positions in each group [count, size of the largest], filled up with n."""
    order = np.argsort(group, kind="stable")[np.count_nonzero(group < 0) :]
    sizes = np.bincount(group[group >= 0], minlength=count)
    starts = np.cumsum(sizes) - sizes
    members = np.full((count, max(1, sizes.max(initial=0))), len(group))
    members[group[order], np.arange(len(order)) - starts[group[order]]] = order
    return members


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


def _is_box(rddl: Any, expression: Any) -> bool:
    """Whether a precondition only compares one action fluent with what no action changes."""
    while expression.etype == ("aggregation", "forall"):
        expression = expression.args[-1]
    if expression.etype[0] == "boolean" and expression.etype[1] in ("^", "&"):
        return all(_is_box(rddl, argument) for argument in expression.args)
    if expression.etype[0] != "relational" or expression.etype[1] not in ("<=", "<", ">=", ">"):
        return False
    sides = [_pvars(argument) for argument in expression.args]
    for (one, other), argument in zip((sides, sides[::-1]), expression.args, strict=True):
        is_action = argument.etype[0] == "pvar" and one & set(rddl.action_fluents)
        if is_action and other <= set(rddl.non_fluents):
            return True
    return False


def _pvars(expression: Any) -> set[str]:
    if not hasattr(expression, "etype"):
        return set()
    if expression.etype[0] == "pvar":
        return {expression.args[0]}
    arguments = expression.args if isinstance(expression.args, (list, tuple)) else []
    return set().union(*map(_pvars, arguments))
