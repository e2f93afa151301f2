"""Replacing the same leaves of the same nodes again and again, most of them by usual values."""

from collections import ChainMap
from collections.abc import Iterable, Mapping

from mdpo_rddl.problem.enumeration.graph import Graph


class Substitution:
    """Nodes with leaves that have usual values, of which few are replaced by others.

    What none of these lead to is worked out once: on a large problem an action changes little.
    """

    def __init__(self, graph: Graph, nodes: Iterable[int], usual: Mapping[int, int]) -> None:
        """Replaces all leaves by their usual values.

        Args:
          graph: which grows.
          nodes: that hold the leaves.
          usual: of each leaf the node in its place.
        """
        self._graph, self._nodes, self._usual = graph, list(nodes), dict(usual)
        self._new, self._users = dict(usual), dict[int, list[int]]()
        for node in graph.needed(self._nodes, graph.kinds(usual)):
            for each in graph.arguments[node]:
                self._users.setdefault(each, []).append(node)
            if node not in usual:
                self._new[node] = graph.remade(node, self._new)

    def __call__(self, values: Mapping[int, int]) -> list[int]:
        """The nodes with leaves replaced by these, and all others by their usual values."""
        changed = {leaf: node for leaf, node in values.items() if self._usual[leaf] != node}
        new = ChainMap(changed, self._new)
        for node in self._above(list(changed)):
            new[node] = self._graph.remade(node, new)
        return [new.get(node, node) for node in self._nodes]

    def _above(self, leaves: Iterable[int]) -> list[int]:
        """All nodes that leaves lead to, arguments first."""
        found: set[int] = set()
        waiting = list(leaves)
        while waiting:
            users = self._users.get(waiting.pop(), ())
            waiting += [node for node in users if node not in found]
            found.update(users)
        return sorted(found)
