"""All joint actions of a problem, of which those that no precondition ever allows are left out."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, product
from typing import Any

import numpy as np

from mdpo_rddl.problem.enumeration.graph import Graph, Kind
from mdpo_rddl.problem.enumeration.grounding import Ground
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.program import Program
from mdpo_rddl.problem.legality import action_box
from mdpo_rddl.problem.limits import GroupLimit

Part = tuple[Mapping[Ground, list[Any]], int]
"""Other values than the default of some variables, and how many of these may have one."""
_MAX_PROPOSALS = 200_000
# values of all variables in all of them
_MAX_VALUES = 20_000_000


def action_variables(env: Any) -> dict[Ground, tuple[Any, list[Any]]]:
    """Per ground action variable its default and its other values.

    Raises:
      NotEnumerableError: for a real action, or an int without bounds.
    """
    found: dict[Ground, tuple[Any, list[Any]]] = {}
    box = action_box(env)
    for name, kind in env.model.action_ranges.items():
        default = np.asarray(env.sampler.noop_actions[name])
        lower, upper = (np.broadcast_to(bound, default.shape) for bound in box[name])
        for place in np.ndindex(default.shape):
            if kind == "bool":
                values: Sequence[Any] = (False, True)
            elif kind == "int" and np.isfinite(lower[place]) and np.isfinite(upper[place]):
                values = range(int(np.ceil(lower[place])), int(np.floor(upper[place])) + 1)
                if len(values) > _MAX_PROPOSALS:
                    raise NotEnumerableError(f"{float(len(values)):.3g} values of {name}")
            elif kind in env.model.type_to_objects:
                values = range(len(env.model.type_to_objects[kind]))
            else:
                raise NotEnumerableError(f"{kind} actions without bounds: {name}")
            own = default[place].item()
            found[name, place] = (own, [value for value in values if value != own])
    return found


def joint_actions(
    variables: Mapping[Ground, tuple[Any, list[Any]]],
    most: float,
    allowed: tuple[Graph, Sequence[int]],
    limits: EnumerationLimits,
    groups: Sequence[GroupLimit] = (),
) -> list[dict[Ground, Any]]:
    """Assignments to the variables, the defaults first and then those that change fewest.

    Args:
      variables: per variable its default and its other values.
      most: largest number of variables that may differ from their defaults.
      allowed: a graph and the preconditions in it.
      limits: for their number.
      groups: preconditions that limit how many of a group of bools are true.

    Raises:
      NotEnumerableError: if there are too many.
    """
    graph, preconditions = allowed
    fixed = [node for node in preconditions if not graph.depends[node] & ~Kind.ACTION]
    defaults = {ground: default for ground, (default, _) in variables.items()}
    variables = _possible(variables, graph, fixed)
    most = int(min(most, len(variables)))
    parts = _parts(variables, most, groups)
    count = _count(parts, most)
    if not fixed:
        _check_legal(count, len(variables), limits)
    changes = _changes(parts, most)
    if len(parts) > 1:
        places = {ground: place for place, ground in enumerate(variables)}
        changes.sort(key=lambda own: (len(own), sorted(places[ground] for ground in own)))
    legal = _may_be_legal(changes, defaults, graph, fixed)
    # the default comes first even where it is illegal, since others are compared with it
    legal[0] = True
    _check_legal(int(np.count_nonzero(legal)), len(variables), limits)
    return [defaults | own for own, good in zip(changes, legal, strict=True) if good]


def _check_legal(count: int, variables: int, limits: EnumerationLimits) -> None:
    if count > limits.actions:
        raise NotEnumerableError(f"more than {limits.actions:,} joint actions")
    if count * variables > _MAX_VALUES:
        raise NotEnumerableError(f"{count:,} joint actions of {variables:,} variables")


def _possible(
    variables: Mapping[Ground, tuple[Any, list[Any]]], graph: Graph, preconditions: Sequence[int]
) -> dict[Ground, tuple[Any, list[Any]]]:
    """The variables with those values that no precondition on them alone forbids."""
    values = {ground: [default, *others] for ground, (default, others) in variables.items()}
    for node in preconditions:
        leaves = [each for each in graph.needed([node]) if graph.operators[each] == "leaf"]
        if len(leaves) != 1 or (ground := graph.values[leaves[0]]) not in values:
            continue
        default, *others = values[ground]
        good = Program(graph, [node]).run({leaves[0]: np.array(others)})[node]
        good = np.broadcast_to(good, len(others))
        values[ground] = [default, *(each for each, one in zip(others, good, strict=True) if one)]
    return {ground: (default, others) for ground, (default, *others) in values.items()}


def _parts(
    variables: Mapping[Ground, tuple[Any, list[Any]]], most: int, groups: Sequence[GroupLimit]
) -> list[Part]:
    """The variables in parts, each with the limit that leaves fewest joint actions."""

    def divided(limit: GroupLimit | None) -> list[Part]:
        members: dict[int, dict[Ground, list[Any]]] = {}
        grouped = {} if limit is None else limit.groups
        for (name, place), (default, others) in variables.items():
            # the limit is for those that are true
            number = int(grouped[name][place]) if name in grouped and not default else -1
            members.setdefault(number, {})[name, place] = others
        return [
            (own, most if limit is None or number < 0 else min(most, int(limit.limits[number])))
            for number, own in members.items()
        ]

    return min((divided(limit) for limit in (None, *groups)), key=lambda each: _size(each, most))


def _size(parts: Sequence[Part], most: int) -> int:
    # of each number of changes, over the parts so far: products of elementary symmetric polynomials
    counts = [1]
    for own, limit in parts:
        mine = [1] + [0] * limit
        for others in own.values():
            for size in range(limit, 0, -1):
                mine[size] += len(others) * mine[size - 1]
        whole = [0] * min(most + 1, len(counts) + limit)
        for before, many in enumerate(counts):
            for size in range(min(limit + 1, len(whole) - before)):
                whole[before + size] += many * mine[size]
        counts = whole
    return sum(counts)


def _count(parts: Sequence[Part], most: int) -> int:
    count = _size(parts, most)
    if count > _MAX_PROPOSALS:
        raise NotEnumerableError(f"{float(count):.3g} joint actions")
    return count


def _changes(parts: Sequence[Part], most: int) -> list[dict[Ground, Any]]:
    found: list[dict[Ground, Any]] = [{}]
    for own, limit in parts:
        mine = list(_part_changes(own, limit))
        found = [old | new for old in found for new in mine if len(old) + len(new) <= most]
    return found


def _part_changes(variables: Mapping[Ground, list[Any]], most: int) -> Iterator[dict[Ground, Any]]:
    for size in range(most + 1):
        for chosen in combinations(variables, size):
            for values in product(*(variables[ground] for ground in chosen)):
                yield dict(zip(chosen, values, strict=True))


def _may_be_legal(
    changes: Sequence[Mapping[Ground, Any]],
    defaults: Mapping[Ground, Any],
    graph: Graph,
    preconditions: Sequence[int],
) -> np.ndarray:
    """Whether none of the preconditions, which read the action alone, forbids each change.

    Raises:
      NotEnumerableError: if they read too many variables for so many changes.
    """
    leaves = [node for node in graph.needed(preconditions) if graph.operators[node] == "leaf"]
    if len(leaves) * len(changes) > _MAX_VALUES:
        raise NotEnumerableError(f"{len(changes):,} joint actions of {len(leaves):,} variables")
    columns = {
        graph.values[node]: np.full(len(changes), defaults[graph.values[node]]) for node in leaves
    }
    for number, change in enumerate(changes):
        for ground, value in change.items():
            if ground in columns:
                columns[ground][number] = value
    values = Program(graph, preconditions).run(
        {node: columns[graph.values[node]] for node in leaves}
    )
    legal = np.ones(len(changes), bool)
    for node in preconditions:
        legal &= values[node]
    return legal
