"""Ground expressions evaluated for many states at once."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from mdpo_rddl.problem.enumeration.graph import Graph
from mdpo_rddl.problem.enumeration.operators import OPERATORS


class Program:
    """The nodes that some outputs need, in an order in which they can be evaluated."""

    def __init__(self, graph: Graph, outputs: Iterable[int]) -> None:
        """Finds what the outputs need."""
        self._constants: dict[int, Any] = {}
        self._steps = []
        for node in graph.needed(outputs):
            operator = graph.operators[node]
            if operator == "constant":
                self._constants[node] = graph.values[node]
            elif operator != "leaf":
                self._steps.append((node, OPERATORS[operator], graph.arguments[node]))

    @property
    def size(self) -> int:
        """Number of operations."""
        return len(self._steps)

    def run(self, leaves: Mapping[int, np.ndarray]) -> dict[int, Any]:
        """The value of every node: an array [N], or a number where it is constant.

        Args:
          leaves: per leaf its values [N].
        """
        values: dict[int, Any] = {**leaves, **self._constants}
        with np.errstate(all="ignore"):
            for node, operator, arguments in self._steps:
                values[node] = operator(*[values[each] for each in arguments])
        return values
