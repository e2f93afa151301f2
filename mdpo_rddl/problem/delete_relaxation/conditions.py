"""The reward as conditions, each with what it is worth while it holds."""

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import NamedTuple

from mdpo_rddl.problem.enumeration.graph import Graph
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError

Interval = tuple[float, float]
# of a reward, which may have more than it has nodes
_MOST = 50_000
# of a product, however it is nested
_MOST_FACTORS = 64


class Condition(NamedTuple):
    """What pays if it holds.

    Attributes:
      worth: of a step at which it holds, above 0.
      nodes: bools that it is made of.
      wanted: of each node whether it is to be true.
      is_any: whether one of them is enough; else all must be as they are wanted.
    """

    worth: float
    nodes: tuple[int, ...]
    wanted: tuple[bool, ...]
    is_any: bool


_Wanted = tuple[tuple[int, bool], ...]


def conditions(graph: Graph, reward: int, limits: EnumerationLimits) -> list[Condition]:
    """The conditions that a reward is made of; terms that are not understood are left out.

    A number is its largest value, where it is never below 0. What is taken from the reward while
    something holds is what is paid while it does not.

    Args:
      graph: of the nodes.
      reward: its node.
      limits: for the time.

    Raises:
      NotEnumerableError: if there are too many, or the reward is too deep.
    """
    try:
        return _conditions(graph, reward, limits)
    except RecursionError:
        raise NotEnumerableError("the reward is too deep") from None


def _conditions(graph: Graph, reward: int, limits: EnumerationLimits) -> list[Condition]:
    bounds = Bounds(graph)
    found: list[Condition] = []
    for worth, wanted in _terms(graph, bounds, reward, 1.0, ()):
        limits.check_time()
        if len(found) >= _MOST:
            raise NotEnumerableError(f"the reward has more than {_MOST:,} conditions")
        if worth == 0.0 or not math.isfinite(worth):
            continue
        nodes = tuple(node for node, _ in wanted)
        truths = tuple(truth == (worth > 0.0) for _, truth in wanted)
        found.append(Condition(abs(worth), nodes, truths, is_any=worth < 0.0))
    return found


def _terms(
    graph: Graph, bounds: "Bounds", node: int, worth: float, wanted: _Wanted
) -> Iterator[tuple[float, _Wanted]]:
    """The terms of worth times a node, given what is wanted besides."""
    operator, arguments = graph.operators[node], graph.arguments[node]
    if graph.is_bool[node] and operator != "constant":
        yield worth, (*wanted, (node, True))
    elif operator in ("+", "-"):
        signs = [1.0] * len(arguments) if operator == "+" else [1.0, -1.0]
        for sign, each in zip(signs, arguments, strict=True):
            yield from _terms(graph, bounds, each, sign * worth, wanted)
    elif operator == "*":
        yield from _factors(graph, bounds, arguments, worth, wanted)
    elif operator == "if":
        test, yes, no = arguments
        yield from _terms(graph, bounds, yes, worth, (*wanted, (test, True)))
        yield from _terms(graph, bounds, no, worth, (*wanted, (test, False)))
    elif wanted:
        yield worth * bounds.largest_product([node]), wanted


def _factors(
    graph: Graph, bounds: "Bounds", factors: Sequence[int], worth: float, wanted: _Wanted
) -> Iterator[tuple[float, _Wanted]]:
    """The terms of a product, of which a single number that is no constant is taken apart."""
    flat = list(islice(_multiplied(graph, factors), _MOST_FACTORS + 1))
    factors = flat if len(flat) <= _MOST_FACTORS else factors
    bools = [each for each in factors if graph.is_bool[each] and not graph.is_constant(each)]
    numbers = [each for each in factors if each not in bools]
    variable = [each for each in numbers if not graph.is_constant(each)]
    taken_apart = variable[0] if len(variable) == 1 else None
    worth *= bounds.largest_product(each for each in numbers if each != taken_apart)
    wanted = (*wanted, *((each, True) for each in bools))
    if taken_apart is not None:
        yield from _terms(graph, bounds, taken_apart, worth, wanted)
    elif wanted:
        yield worth, wanted


def _multiplied(graph: Graph, factors: Iterable[int]) -> Iterator[int]:
    """The factors of a product, however they are nested; many times those that are shared."""
    for factor in factors:
        if graph.operators[factor] == "*" and not graph.is_bool[factor]:
            yield from _multiplied(graph, graph.arguments[factor])
        else:
            yield factor


class Bounds:
    """Between what numbers the nodes of a graph lie."""

    def __init__(self, graph: Graph) -> None:
        """Knows none yet."""
        self._graph = graph
        self._known: dict[int, Interval] = {}

    def largest_product(self, nodes: Iterable[int]) -> float:
        """The product of the largest values of factors, of which constants may be below 0.

        Infinite where the other factors may have a product below 0.
        """
        constants, rest = 1.0, (1.0, 1.0)
        for node in nodes:
            if self._graph.is_constant(node):
                constants *= self(node)[1]
            else:
                rest = _product(rest, self(node))
        return constants * (rest[1] if rest[0] >= 0.0 else math.inf)

    def __call__(self, node: int) -> Interval:
        """The smallest and the largest value, or an interval that has both."""
        for each in self._graph.needed([node]):
            if each not in self._known:
                self._known[each] = self._of(each)
        return self._known[node]

    def _of(self, node: int) -> Interval:
        graph = self._graph
        operator = graph.operators[node]
        if operator == "constant":
            value = float(graph.values[node])
            return value, value
        if graph.is_bool[node]:
            return 0.0, 1.0
        parts = [self._known[each] for each in graph.arguments[node]]
        lows, highs = [low for low, _ in parts], [high for _, high in parts]
        if operator == "+":
            return sum(lows), sum(highs)
        if operator == "-":
            return lows[0] - highs[1], highs[0] - lows[1]
        if operator == "*":
            product = parts[0]
            for each in parts[1:]:
                product = _product(product, each)
            return product
        if operator == "if":
            return min(lows[1:]), max(highs[1:])
        if operator in ("min", "minimum"):
            return min(lows), min(highs)
        if operator in ("max", "maximum"):
            return max(lows), max(highs)
        return -math.inf, math.inf


def _product(one: Interval, other: Interval) -> Interval:
    ends = [x * y if x and y else 0.0 for x in one for y in other]
    return min(ends), max(ends)
