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
) -> list[dict[Ground, Any]]:
    """Assignments to the variables, the defaults first.

    Args:
      variables: per variable its default and its other values.
      most: largest number of variables that may differ from their defaults.
      allowed: a graph and the preconditions in it.
      limits: for their number.

    Raises:
      NotEnumerableError: if there are too many.
    """
    most = int(min(most, len(variables)))
    count = _count([len(others) for _, others in variables.values()], most)
    graph, preconditions = allowed
    fixed = [node for node in preconditions if not graph.depends[node] & ~Kind.ACTION]
    if not fixed:
        _check_legal(count, len(variables), limits)
    defaults = {ground: default for ground, (default, _) in variables.items()}
    changes = list(_changes(variables, most))
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


def _count(others: Sequence[int], most: int) -> int:
    # of each number of changes, over the variables so far: elementary symmetric polynomials
    counts = [1] + [0] * most
    for each in others:
        for size in range(most, 0, -1):
            counts[size] += each * counts[size - 1]
    count = sum(counts)
    if count > _MAX_PROPOSALS:
        raise NotEnumerableError(f"{float(count):.3g} joint actions")
    return count


def _changes(
    variables: Mapping[Ground, tuple[Any, list[Any]]], most: int
) -> Iterator[dict[Ground, Any]]:
    for size in range(most + 1):
        for chosen in combinations(variables, size):
            for values in product(*(variables[ground][1] for ground in chosen)):
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
