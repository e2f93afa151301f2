"""Nodes of a graph evaluated in groups of the same operator, for few values of many nodes."""

from collections.abc import Iterable, Mapping

import numpy as np

from mdpo_rddl.problem.enumeration.graph import Graph
from mdpo_rddl.problem.enumeration.operators import OPERATORS, REDUCED

# arguments of a node: more are put together at once
_MANY_ARGUMENTS = 8


class LayeredProgram:
    """The nodes that some outputs need, by levels; within one, each operator is applied once.

    `Program` applies an operator for each node, which takes as long for one value as for hundreds.
    All values are floats here, bools among them.
    """

    def __init__(self, graph: Graph, outputs: Iterable[int]) -> None:
        """Puts the nodes in order: constants, leaves, then groups by levels."""
        groups: dict[tuple[int, str, int], list[int]] = {}
        levels: dict[int, int] = {}
        constants, leaves = [], []
        for node in graph.needed(outputs):
            operator, arguments = graph.operators[node], graph.arguments[node]
            levels[node] = 1 + max((levels[each] for each in arguments), default=-1)
            if operator == "constant":
                constants.append(node)
            elif operator == "leaf":
                leaves.append(node)
            else:
                key = levels[node], operator, len(arguments)
                groups.setdefault(key, []).append(node)
        ordered = [*constants, *leaves]
        for key in sorted(groups):
            ordered += groups[key]
        self._rows = {node: row for row, node in enumerate(ordered)}
        self._constants = np.array([float(graph.values[node]) for node in constants])
        self._leaves = leaves
        self._groups = []
        for key in sorted(groups):
            nodes, (_, operator, _) = groups[key], key
            start = self._rows[nodes[0]]
            columns = zip(*(graph.arguments[node] for node in nodes), strict=True)
            places = [np.array([self._rows[each] for each in column]) for column in columns]
            reduces = operator in REDUCED and len(places) > _MANY_ARGUMENTS
            places = [np.array(places)] if reduces else places
            self._groups.append((operator, reduces, places, start, start + len(nodes)))

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self._rows)

    def run(self, leaves: Mapping[int, np.ndarray], count: int) -> "Evaluated":
        """The value of every node.

        Args:
          leaves: per leaf its values [N].
          count: N.
        """
        values = np.empty((len(self._rows), count))
        values[: len(self._constants)] = self._constants[:, np.newaxis]
        for row, leaf in enumerate(self._leaves, start=len(self._constants)):
            values[row] = leaves[leaf]
        with np.errstate(all="ignore"):
            for operator, reduces, places, start, stop in self._groups:
                # faster than values[place] for few columns
                given = [values.take(place, axis=0, mode="clip") for place in places]
                if reduces:
                    REDUCED[operator].reduce(given[0], axis=0, out=values[start:stop])
                else:
                    values[start:stop] = OPERATORS[operator](*given)
        return Evaluated(values, self._rows)


class Evaluated:
    """Values by their nodes."""

    def __init__(self, values: np.ndarray, rows: Mapping[int, int]) -> None:
        """Keeps them.

        Args:
          values: of each row [R, N].
          rows: of each node.
        """
        self._values, self._rows = values, rows

    def __getitem__(self, node: int) -> np.ndarray:
        """The values of a node [N]."""
        found: np.ndarray = self._values[self._rows[node]]
        return found
