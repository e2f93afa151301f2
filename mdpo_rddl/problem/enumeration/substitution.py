"""Replacing the same leaves of the same nodes again and again, most of them by usual values."""

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

    def __call__(self, values: Mapping[int, int], places: Iterable[int] | None = None) -> list[int]:
        """The nodes with leaves replaced by these, and all others by their usual values.

        Args:
          values: of some leaves the nodes in their places.
          places: of the nodes that are wanted; all if None.
        """
        new = {leaf: node for leaf, node in values.items() if self._usual[leaf] != node}
        graph, usual = self._graph, self._new
        for node in self._above(list(new)):
            old = graph.arguments[node]
            arguments = tuple([new[e] if e in new else usual.get(e, e) for e in old])
            new[node] = node if arguments == old else graph.make(graph.operators[node], *arguments)
        nodes = self._nodes if places is None else [self._nodes[place] for place in places]
        return [new[node] if node in new else usual.get(node, node) for node in nodes]

    def _above(self, leaves: Iterable[int]) -> list[int]:
        """All nodes that leaves lead to, arguments first."""
        found: set[int] = set()
        waiting = list(leaves)
        while waiting:
            users = self._users.get(waiting.pop(), ())
            waiting += [node for node in users if node not in found]
            found.update(users)
        return sorted(found)
