"""Next values that depend on each other, for they read the same random fluents of the step.

What they read is drawn first, value by value; given that, each has a law of its own.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from math import prod
from typing import NamedTuple

from mdpo_rddl.problem.enumeration.graph import Graph, Kind
from mdpo_rddl.problem.enumeration.laws import Branch, Law, law_nodes
from mdpo_rddl.problem.enumeration.limits import NotEnumerableError

_MAX_COMBINATIONS = 4096
_MAX_BRANCHES = 1024
_TOO_MANY = f"fluents that have more than {_MAX_BRANCHES:,} values together"


class JointBranch(NamedTuple):
    """A value of each variable, and the probability of all: nodes."""

    values: tuple[int, ...]
    probability: int


JointLaw = tuple[JointBranch, ...]
"""What some variables may be together; the probabilities sum to 1."""


def combinations(
    graph: Graph, nodes: Iterable[int], laws: Mapping[int, Law]
) -> list[tuple[dict[int, int], int]]:
    """What random leaves that the nodes read may be together, with the probability's node.

    Args:
      graph: of the nodes.
      nodes: that read leaves.
      laws: per leaf that stands for a random variable its law, which may read other leaves; else
        it is independent of them.

    Raises:
      NotEnumerableError: if there are too many.
    """
    order = ordered_leaves(graph, nodes, laws)
    _check_count(graph, order, laws)
    found: list[tuple[dict[int, int], int]] = [({}, graph.one)]
    for leaf in order:
        longer = []
        for values, probability in found:
            for branch in laws[leaf]:
                value, own = graph.substitute(branch, values)
                both = graph.make("*", probability, own)
                if not _is_zero(graph, both):
                    longer.append(({**values, leaf: value}, both))
        found = longer
    return found


def check_combinations(graph: Graph, nodes: Iterable[int], laws: Mapping[int, Law]) -> None:
    """Raises what `combinations` would raise, at once."""
    _check_count(graph, ordered_leaves(graph, nodes, laws), laws)


def _check_count(graph: Graph, leaves: Iterable[int], laws: Mapping[int, Law]) -> None:
    values = (sum(not _is_zero(graph, each.probability) for each in laws[leaf]) for leaf in leaves)
    if prod(values) > _MAX_COMBINATIONS:
        raise NotEnumerableError("many random fluents of a step are read together")


def leaves_of(graph: Graph, nodes: Iterable[int], laws: Mapping[int, Law]) -> set[int]:
    """The random leaves that the nodes read, themselves or by another leaf's law."""
    found: set[int] = set()
    waiting = _direct(graph, nodes)
    while waiting:
        found |= waiting
        waiting = _direct(graph, (n for leaf in waiting for n in law_nodes(laws[leaf]))) - found
    return found


def joint_law(
    graph: Graph,
    variables: Sequence[tuple[Law, bool]],
    laws: Mapping[int, Law],
    check_time: Callable[[], None] = lambda: None,
) -> JointLaw:
    """The law of some variables together.

    Args:
      graph: of the nodes.
      variables: of each its law, and whether it is a bool, whose law has one branch, the
        probability of true.
      laws: per random leaf its law.
      check_time: called now and then; what it raises is passed on.

    Raises:
      NotEnumerableError: if it has too many branches.
    """
    nodes = [node for law, _ in variables for node in law_nodes(law)]
    joined: dict[tuple[int, ...], int] = {}
    for values, probability in combinations(graph, nodes, laws):
        check_time()
        new = iter(graph.substitute(nodes, values))
        given = [
            _split(graph, [Branch(next(new), next(new)) for _ in law], is_bool)
            for law, is_bool in variables
        ]
        if prod(map(len, given)) > _MAX_BRANCHES:
            raise NotEnumerableError(_TOO_MANY)
        for chosen in product(*given):
            both = graph.make("*", probability, *(each.probability for each in chosen))
            if _is_zero(graph, both):
                continue
            key = tuple(each.value for each in chosen)
            joined[key] = both if key not in joined else graph.make("+", joined[key], both)
        if len(joined) > _MAX_BRANCHES:
            raise NotEnumerableError(_TOO_MANY)
    return tuple(JointBranch(*item) for item in joined.items())


def _is_zero(graph: Graph, node: int) -> bool:
    return graph.is_constant(node) and graph.values[node] == 0


def nodes_of(law: JointLaw) -> list[int]:
    """All nodes of a joint law."""
    return [node for branch in law for node in (*branch.values, branch.probability)]


def _split(graph: Graph, law: Sequence[Branch], is_bool: bool) -> Sequence[Branch]:
    """The values of a bool whose probability of true is known."""
    truth = law[0].value
    if not is_bool or graph.is_bool[truth]:
        return law
    if graph.is_constant(truth) and graph.values[truth] in (0, 1):
        return [Branch(graph.constant(bool(graph.values[truth])), graph.one)]
    return [
        Branch(graph.true, truth),
        Branch(graph.false, graph.make("-", graph.one, truth)),
    ]


def _direct(graph: Graph, nodes: Iterable[int]) -> set[int]:
    read = graph.needed(nodes, Kind.DRAWN)
    return {node for node in read if graph.operators[node] == "leaf"}


def ordered_leaves(graph: Graph, nodes: Iterable[int], laws: Mapping[int, Law]) -> list[int]:
    """The leaves, those that another one's law reads before it."""
    order: list[int] = []

    def add(leaf: int) -> None:
        if leaf not in order:
            for other in sorted(_direct(graph, law_nodes(laws[leaf]))):
                add(other)
            order.append(leaf)

    for leaf in sorted(_direct(graph, nodes)):
        add(leaf)
    return order
