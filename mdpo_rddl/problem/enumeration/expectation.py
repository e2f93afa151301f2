"""The expectation of an expression over random variables of the same step."""

from collections.abc import Mapping

from mdpo_rddl.problem.enumeration.graph import Graph, Kind
from mdpo_rddl.problem.enumeration.joint import combinations
from mdpo_rddl.problem.enumeration.laws import Law


def expectation(graph: Graph, node: int, laws: Mapping[int, Law]) -> int:
    """The node of an expectation.

    A sum is taken apart first, since each of its terms reads few variables.

    Args:
      graph: of the nodes.
      node: whose expectation is wanted.
      laws: per leaf that stands for a random variable its law, which may read other leaves.

    Raises:
      NotEnumerableError: if a term reads too many random variables.
    """
    if not graph.depends[node] & Kind.DRAWN:
        return node
    operator, arguments = graph.operators[node], graph.arguments[node]
    if operator == "+":
        return graph.make("+", *(expectation(graph, each, laws) for each in arguments))
    if operator == "-":
        return graph.make("-", *(expectation(graph, each, laws) for each in arguments))
    if operator == "*":
        random = [each for each in arguments if graph.depends[each] & Kind.DRAWN]
        if len(random) == 1:
            fixed = [each for each in arguments if each != random[0]]
            return graph.make("*", *fixed, expectation(graph, random[0], laws))
    return _over_combinations(graph, node, laws)


def _over_combinations(graph: Graph, node: int, laws: Mapping[int, Law]) -> int:
    terms = []
    for values, probability in combinations(graph, [node], laws):
        (value,) = graph.substitute([node], values)
        terms.append(graph.weighted(value, probability))
    return graph.make("+", *terms)
