"""Costs as a circuit of sums and minima in which no expression stands twice.

Nodes are numbered in the order of their making, so that arguments come before what uses them.
"""

import math
from collections.abc import Hashable, Iterable, Sequence
from enum import Enum
from typing import NamedTuple

Assignment = tuple[tuple[int, int], ...]
"""Numbers of action variables, each with the number of one of its other values than the default."""


class Part(Enum):
    """What a node is."""

    CONSTANT = 0
    LITERAL = 1
    TOTAL = 2
    LEAST = 3
    PLAYED = 4


class Literal(NamedTuple):
    """That a state variable has a value: numbers of both."""

    variable: int
    value: int


class Circuit:
    """A growing circuit.

    Attributes:
      parts: of each node what it is.
      arguments: of each node the numbers of its arguments.
      constants: of a constant its cost, else 0.
      literals: per literal its node.
      assignments: of a node that plays actions, these.
      size: number of all arguments.
      free, impossible: the nodes of the costs 0 and infinity.
    """

    def __init__(self) -> None:
        """Starts with two constants."""
        self.parts: list[Part] = []
        self.arguments: list[tuple[int, ...]] = []
        self.constants: list[float] = []
        self.literals: dict[Literal, int] = {}
        self.assignments: dict[int, Assignment] = {}
        self.size = 0
        self._numbers: dict[Hashable, int] = {}
        self.free, self.impossible = self.constant(0.0), self.constant(math.inf)

    def constant(self, cost: float) -> int:
        """The node of a cost that is known."""
        return self._number((Part.CONSTANT, cost), Part.CONSTANT, (), cost)

    def literal(self, literal: Literal) -> int:
        """The node of what it costs to make a literal true."""
        number = self.literals[literal] = self._number(literal, Part.LITERAL, ())
        return number

    def total(self, nodes: Iterable[int]) -> int:
        """The node of a sum, in which a cost counts once, but for constants, which are chances."""
        found, known, seen = set[int](), 0.0, set[int]()
        for node in nodes:
            if node in seen:
                continue
            if self.parts[node] is not Part.CONSTANT:
                seen.add(node)
            for each in self.arguments[node] if self.parts[node] is Part.TOTAL else (node,):
                if self.parts[each] is Part.CONSTANT:
                    known += self.constants[each]
                else:
                    found.add(each)
        if known == math.inf:
            return self.impossible
        if known > 0.0:
            found.add(self.constant(known))
        return self._joined(found, Part.TOTAL, self.free)

    def least(self, nodes: Iterable[int]) -> int:
        """The node of the smallest of some costs."""
        found: set[int] = set()
        for node in nodes:
            found.update(self.arguments[node] if self.parts[node] is Part.LEAST else (node,))
        if self.free in found:
            return self.free
        return self._joined(found - {self.impossible}, Part.LEAST, self.impossible)

    def played(self, cost: int, assignment: Assignment) -> int:
        """The node of a cost that is paid by playing actions: that of making them legal."""
        if cost == self.impossible:
            return cost
        number = self._number((Part.PLAYED, assignment, cost), Part.PLAYED, (cost,))
        self.assignments[number] = assignment
        return number

    def _joined(self, found: set[int], part: Part, none: int) -> int:
        if len(found) < 2:
            return next(iter(found), none)
        arguments = tuple(sorted(found))
        return self._number((part, arguments), part, arguments)

    def _number(
        self, key: Hashable, part: Part, arguments: Sequence[int], constant: float = 0.0
    ) -> int:
        number = self._numbers.get(key)
        if number is None:
            number = self._numbers[key] = len(self.parts)
            self.parts.append(part)
            self.arguments.append(tuple(arguments))
            self.size += len(arguments)
            self.constants.append(constant)
        return number
