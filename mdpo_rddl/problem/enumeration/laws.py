"""Distributions of ground expressions, as values with probabilities that are expressions too.

Two draws that stand in different places of an expression are independent, so that the law of
an operator's result follows from those of its arguments.
"""

from collections.abc import Sequence
from itertools import product, zip_longest
from math import prod
from typing import NamedTuple

from mdpo_rddl.problem.enumeration.graph import Graph
from mdpo_rddl.problem.enumeration.limits import NotEnumerableError

_MAX_VALUES = 256
# of the arguments of one operator together, before equal values are joined
_MAX_COMBINATIONS = 2**16
# of many arguments two at a time are combined
_ASSOCIATIVE = ("and", "or", "+", "*", "minimum", "maximum", "min", "max")


class Branch(NamedTuple):
    """A value and its probability, both nodes."""

    value: int
    probability: int


Law = tuple[Branch, ...]
"""What an expression may be: one branch where nothing is random; the probabilities sum to 1."""


def law_nodes(law: Law) -> list[int]:
    """All nodes of a law."""
    return [node for branch in law for node in branch]


class Laws:
    """Makes laws of laws, in one graph."""

    def __init__(self, graph: Graph) -> None:
        """Keeps the graph."""
        self.graph = graph

    def certain(self, value: int) -> Law:
        """The law of what is not random."""
        return (Branch(value, self.graph.one),)

    def bernoulli(self, probability: int) -> Law:
        """True with a probability."""
        graph = self.graph
        if graph.is_bool[probability]:
            return self.certain(probability)
        if graph.is_constant(probability) and graph.values[probability] in (0, 1):
            return self.certain(graph.constant(bool(graph.values[probability])))
        return (
            Branch(graph.true, probability),
            Branch(graph.false, graph.make("-", graph.one, probability)),
        )

    def truth(self, law: Law) -> int:
        """The probability of true: a bool node where nothing is random."""
        if len(law) == 1:
            return law[0].value
        graph = self.graph
        parts = [graph.weighted(value, probability) for value, probability in law]
        return graph.make("+", *parts)

    def mean(self, law: Law) -> int:
        """The expectation."""
        return self.truth(law)

    def apply(self, operator: str, laws: Sequence[Law]) -> Law:
        """The law of an operator's result, its arguments independent."""
        graph = self.graph
        if all(len(law) == 1 for law in laws):
            return self.certain(graph.make(operator, *(law[0].value for law in laws)))
        if operator in _ASSOCIATIVE and len(laws) > 2:
            result = laws[0]
            for law in laws[1:]:
                result = self.apply(operator, (result, law))
            return result
        if prod(map(len, laws)) > _MAX_COMBINATIONS:
            raise NotEnumerableError(f"more than {_MAX_COMBINATIONS:,} values of one expression")
        branches = []
        for combination in product(*laws):
            value = graph.make(operator, *(branch.value for branch in combination))
            probability = graph.make("*", *(branch.probability for branch in combination))
            branches.append(Branch(value, probability))
        return self.collected(branches)

    def choose(self, condition: Law, yes: Law, no: Law) -> Law:
        """The law of if-then-else."""
        if len(condition) > 1:
            return self.apply("if", (condition, yes, no))
        graph, test = self.graph, condition[0].value
        if graph.is_constant(test):
            return yes if graph.values[test] else no
        if self._is_bool(yes) and self._is_bool(no):
            return self.bernoulli(graph.make("if", test, self.truth(yes), self.truth(no)))
        branches = []
        for one, other in zip_longest(yes, no):
            one = one or Branch(other.value, graph.zero)
            other = other or Branch(one.value, graph.zero)
            value = graph.make("if", test, one.value, other.value)
            probability = graph.make("if", test, one.probability, other.probability)
            branches.append(Branch(value, probability))
        return tuple(branches)

    def _is_bool(self, law: Law) -> bool:
        return all(self.graph.is_bool[branch.value] for branch in law)

    def collected(self, branches: Sequence[Branch]) -> Law:
        """The branches with those of equal values joined."""
        if all(self.graph.is_bool[branch.value] for branch in branches):
            return self.bernoulli(self.truth(tuple(branches)))
        joined: dict[int, int] = {}
        for value, probability in branches:
            before = joined.get(value)
            joined[value] = (
                probability if before is None else self.graph.make("+", before, probability)
            )
        if len(joined) > _MAX_VALUES:
            raise NotEnumerableError(f"a random expression has more than {_MAX_VALUES} values")
        return tuple(Branch(*item) for item in joined.items())
