"""Neighbours of an action's objects, found by types alone.

The nearest are those that one relation of two objects leads to. Of a grid, whose places are tuples,
neighbours are related by a relation of two tuples: NEIGHBOR(?x1, ?y1, ?x2, ?y2). And where a
relation leads from an action's objects to those of another type, what lies a step before or behind
matters as well: the cells that flow into the cells that flow into a junction.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

# numbers of a matrix: a larger one takes too long at every step
_MOST = 10**6


class Neighbours(NamedTuple):
    """Which objects of a fluent are neighbours of an action's objects.

    Attributes:
      name: of the relations, with their directions.
      kind: type of the action's argument that they are neighbours of; None if of all arguments.
      weights: each object's or tuple's mean over its neighbours [objects, values of the fluent].
    """

    name: str
    kind: str | None
    weights: np.ndarray


class _Step(NamedTuple):
    """A relation of two objects in one direction: a mean [here, there]."""

    name: str
    here: str
    there: str
    mean: np.ndarray


def related_neighbours(
    rddl: Any, values: Mapping[str, Any], own: Sequence[str], types: Sequence[str]
) -> list[Neighbours]:
    """Neighbours through one relation of two objects, in both directions.

    Args:
      rddl: pyRDDLGym's lifted model.
      values: per fluent and non-fluent, an array of its shape; read for the non-fluents.
      own: types of the fluent's arguments; of more or fewer than one there are no such neighbours.
      types: types of the action's arguments.
    """
    return [
        Neighbours(step.name, step.here, step.mean)
        for step in _steps(rddl, values)
        if [step.there] == list(own) and step.here in types and np.any(step.mean)
    ]


def distant_neighbours(
    rddl: Any, values: Mapping[str, Any], own: Sequence[str], types: Sequence[str]
) -> list[Neighbours]:
    """Neighbours through a relation of two tuples, or through two relations of objects.

    Args:
      rddl: pyRDDLGym's lifted model.
      values: per fluent and non-fluent, an array of its shape; read for the non-fluents.
      own: types of the fluent's arguments.
      types: types of the action's arguments.
    """
    if len(own) == 1:
        return [*_in_two_steps(rddl, values, own[0], types)]
    return [*_of_tuples(rddl, values, list(own), list(types))]


def _of_tuples(
    rddl: Any, values: Mapping[str, Any], own: list[str], types: list[str]
) -> Iterator[Neighbours]:
    if not own or own != types:
        return
    for relation in _relations(rddl, 2 * len(own)):
        if rddl.variable_params[relation] != own + types or np.size(values[relation]) > _MOST:
            continue
        array = np.asarray(values[relation], float)
        matrix = array.reshape(int(np.prod(array.shape[: len(own)])), -1)
        if np.any(matrix):
            yield Neighbours(f"to {relation}", None, _mean(matrix))
        if not np.array_equal(matrix, matrix.T):
            yield Neighbours(f"from {relation}", None, _mean(matrix.T))


def _in_two_steps(
    rddl: Any, values: Mapping[str, Any], kind: str, types: Sequence[str]
) -> Iterator[Neighbours]:
    """One step from the action's type to the fluent's, and one among objects of the latter."""
    steps = [step for step in _steps(rddl, values) if step.there == kind]
    for first in steps:
        if first.here == kind or first.here not in types:
            continue
        for second in steps:
            if second.here != kind or first.mean.shape[0] * second.mean.shape[1] > _MOST:
                continue
            weights = first.mean @ second.mean
            if np.any(weights):
                yield Neighbours(f"{second.name} {first.name}", first.here, weights)


def _steps(rddl: Any, values: Mapping[str, Any]) -> Iterator[_Step]:
    for relation in _relations(rddl, 2):
        here, there = rddl.variable_params[relation]
        matrix = np.asarray(values[relation], float)
        yield _Step(f"from {relation}", here, there, _mean(matrix))
        yield _Step(f"to {relation}", there, here, _mean(matrix.T))


def _relations(rddl: Any, arguments: int) -> list[str]:
    params, ranges = rddl.variable_params, rddl.variable_ranges
    names = rddl.non_fluents
    return [n for n in names if ranges[n] == "bool" and len(params[n]) == arguments]


def _mean(weights: np.ndarray) -> np.ndarray:
    return weights / np.maximum(weights.sum(axis=1, keepdims=True), 1.0)
