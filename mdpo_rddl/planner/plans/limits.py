"""Bool actions that keep the limits on their groups, relaxed and exact."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mdpo_rddl.planner.plans.features import array_module
from mdpo_rddl.problem.limits import GroupLimit

if TYPE_CHECKING:  # who plays on numpy need not import it
    from jax import Array


def scale_to_limits(
    probabilities: Mapping[str, "Array"], limits: Sequence[GroupLimit]
) -> dict[str, "Array"]:
    """Scales relaxed bools [*shape] down so that each group's sum keeps its limit.

    The gradient passes through the scale. Groups within their limit stay as they are.
    """
    from jax import numpy as jnp

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
    probabilities: Mapping[str, Any], limits: Sequence[GroupLimit]
) -> dict[str, Any]:
    """Bool actions [*shape] that keep every limit: the likeliest of each group.

    A component is true if its probability is above 0.5 and it is among the group's
    `limit` likeliest; under an exact limit, if it is among them at all. Of numpy's arrays an axis
    of replicas may follow [*shape, B].
    """
    chosen = {name: value > 0.5 for name, value in probabilities.items()}
    allowed = {n: array_module(v).ones_like(v, bool) for n, v in probabilities.items()}
    for limit in limits:
        names = list(limit.groups)
        xp = array_module(probabilities[names[0]])
        group = np.concatenate([np.ravel(limit.groups[name]) for name in names])
        sizes = [limit.groups[name].size for name in names]
        shape = np.shape(probabilities[names[0]])
        rest = shape[limit.groups[names[0]].ndim :] if xp is np else ()
        values, picked, free = (
            xp.concatenate(
                [xp.reshape(tree[n], (size, *rest)) for n, size in zip(names, sizes, strict=True)]
            )
            for tree in (probabilities, chosen, allowed)
        )
        is_member = (group >= 0).reshape(-1, *(1 for _ in rest))
        candidates = free & (picked | (limit.exact & is_member))
        # what is no candidate ranks last, so that it takes no place
        ranked = xp.where(candidates, values, -1.0)
        largest = _are_largest_of_replicas if rest else are_largest
        within = largest(ranked, group, limit.limits)
        picked, free = candidates & within, free & within
        start = 0
        for name, size in zip(names, sizes, strict=True):
            shape, part = np.shape(probabilities[name]), slice(start, start + size)
            chosen[name] = xp.reshape(picked[part], shape)
            allowed[name] = xp.reshape(free[part], shape)
            start = part.stop
    return chosen


def _group_sums(values: "Array", group: np.ndarray, count: int) -> "Array":
    import jax
    from jax import numpy as jnp

    ids = np.where(group < 0, count, group)
    return jax.ops.segment_sum(jnp.ravel(values), np.ravel(ids), count + 1)[:count]


def are_largest(values: "Array", group: np.ndarray, limits: np.ndarray) -> "Array":
    """Whether each value is among the `limit` largest of its group [n]; ties by position.

    Values in no group are.

    Args:
      values: [n].
      group: of each value, below 0 of those in none [n].
      limits: of the groups.
    """
    import jax
    from jax import numpy as jnp

    members = _members(group, len(limits))
    places = int(np.clip(np.max(limits), 1, members.shape[1]))
    table = _by_group(values, members)
    if places == 1:  # without a sort and a scatter
        best = jnp.argmax(table, axis=1, keepdims=True)
        is_best = (best == np.arange(members.shape[1])) & (limits > 0)[:, np.newaxis]
        return _in_order(is_best, group, members)
    _, top = jax.lax.top_k(table, places)
    largest = jnp.take_along_axis(jnp.asarray(members), top, axis=1)
    is_within = np.arange(places) < limits[:, np.newaxis]
    chosen = jnp.zeros(len(values) + 1, bool).at[largest].max(is_within)
    return chosen[:-1] | (group < 0)


def _are_largest_of_replicas(
    values: np.ndarray, group: np.ndarray, limits: np.ndarray
) -> np.ndarray:
    """`are_largest` of numpy's values [n, B]."""
    members = _members(group, len(limits))
    last = np.full((1, values.shape[1]), -np.inf, values.dtype)
    table = np.concatenate([values, last])[members]
    order = np.argsort(-table, axis=1, kind="stable")
    ranks = np.empty_like(order)
    np.put_along_axis(ranks, order, np.arange(members.shape[1])[:, np.newaxis], axis=1)
    chosen = np.zeros((len(values) + 1, values.shape[1]), bool)
    chosen[members] = ranks < limits[:, np.newaxis, np.newaxis]
    return chosen[:-1] | (group < 0)[:, np.newaxis]


def _by_group(values: "Array", members: np.ndarray) -> "Array":
    """The values of each group's members [G, K]; minus infinity where it has fewer."""
    from jax import numpy as jnp

    # the members of a group often are a row or a column: on a CPU gathering them takes longer
    if _are_rows(members, len(values)):
        return jnp.reshape(values, members.shape)
    if _are_rows(members.T, len(values)):
        return jnp.reshape(values, members.T.shape).T
    return jnp.append(values, -jnp.inf)[members]


def _in_order(table: "Array", group: np.ndarray, members: np.ndarray) -> "Array":
    """What is said of each group's members [G, K] in the order of the values [n]; true of those
    in no group."""
    from jax import numpy as jnp

    count = len(group)
    if _are_rows(members, count):
        return jnp.ravel(table)
    if _are_rows(members.T, count):
        return jnp.ravel(table.T)
    place = np.zeros(count + 1, int)
    place[members] = np.arange(members.size).reshape(members.shape)
    return jnp.ravel(table)[place[:-1]] | (group < 0)


def _members(group: np.ndarray, count: int) -> np.ndarray:
    """The positions in each group [count, size of the largest], filled up with n."""
    order = np.argsort(group, kind="stable")[np.count_nonzero(group < 0) :]
    sizes = np.bincount(group[group >= 0], minlength=count)
    starts = np.cumsum(sizes) - sizes
    members = np.full((count, max(1, sizes.max(initial=0))), len(group))
    members[group[order], np.arange(len(order)) - starts[group[order]]] = order
    return members


def _are_rows(members: np.ndarray, count: int) -> bool:
    """Whether each group has as many values side by side, and each value is in one."""
    return members.size == count and bool(np.all(np.ravel(members) == np.arange(count)))
