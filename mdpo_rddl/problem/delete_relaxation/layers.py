"""A circuit as layers of sums and minima of two, each evaluated at once."""

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mdpo_rddl.problem.delete_relaxation.circuit import Assignment, Circuit, Part


class Pair(NamedTuple):
    """A sum or a minimum of two rows, or what it costs to play actions, with itself."""

    level: int
    part: Part
    one: int
    other: int


class Layer(NamedTuple):
    """Rows `start` to `stop`, all of one kind, which follow from earlier rows."""

    part: Part
    one: np.ndarray
    other: np.ndarray
    start: int
    stop: int


@dataclass(frozen=True)
class Layered:
    """A circuit in rows: those that are given, then pairs by their levels.

    Attributes:
      rows: number of rows.
      layers: in the order in which they are evaluated.
      pairs: per row that is one.
      assignments: of a row that plays actions, these.
    """

    rows: int
    layers: tuple[Layer, ...]
    pairs: Mapping[int, Pair]
    assignments: Mapping[int, Assignment]


def layered(circuit: Circuit, places: dict[int, int], begun: int) -> Layered:
    """Puts a circuit in layers.

    Args:
      circuit: of costs.
      places: of each node that is given its row; those of all others are added.
      begun: the number of rows that are given.
    """
    growing = _Growing(begun)
    for node, part in enumerate(circuit.parts):
        if node in places:
            continue
        arguments = [places[each] for each in circuit.arguments[node]]
        if part is Part.PLAYED:
            places[node] = growing.played(arguments[0], circuit.assignments[node])
        else:
            places[node] = growing.joined(part, arguments)
    rows = growing.rows()
    for node, place in places.items():
        places[node] = rows.get(place, place)
    pairs = {
        rows[begun + number]: pair._replace(
            one=rows.get(pair.one, pair.one), other=rows.get(pair.other, pair.other)
        )
        for number, pair in enumerate(growing.pairs)
    }
    ordered = [pairs[row] for row in sorted(pairs)]
    assignments = {rows[place]: found for place, found in growing.assignments.items()}
    return Layered(begun + len(pairs), tuple(_layers(ordered, begun)), pairs, assignments)


class _Growing:
    """Pairs in the order of their making."""

    def __init__(self, begun: int) -> None:
        self.pairs: list[Pair] = []
        self.assignments: dict[int, Assignment] = {}
        self._begun = begun
        self._numbers: dict[tuple[Part, int, int], int] = {}

    def played(self, cost: int, assignment: Assignment) -> int:
        """The place of what plays actions."""
        place = self._add(Pair(1 + self._level(cost), Part.PLAYED, cost, cost))
        self.assignments[place] = assignment
        return place

    def joined(self, part: Part, places: Sequence[int]) -> int:
        """The place of a sum or minimum, by two at a time, those of the lowest levels first."""
        heap = [(self._level(place), place) for place in places]
        heapq.heapify(heap)
        while len(heap) > 1:
            one, other = sorted((heapq.heappop(heap)[1], heapq.heappop(heap)[1]))
            if (key := (part, one, other)) not in self._numbers:
                level = 1 + max(self._level(one), self._level(other))
                self._numbers[key] = self._add(Pair(level, part, one, other))
            heapq.heappush(heap, (self._level(self._numbers[key]), self._numbers[key]))
        return heap[0][1]

    def rows(self) -> dict[int, int]:
        """Of each pair's place its row: by levels, and by kinds within them."""
        order = sorted(
            range(len(self.pairs)),
            key=lambda each: (self.pairs[each].level, self.pairs[each].part.value),
        )
        return {self._begun + each: self._begun + row for row, each in enumerate(order)}

    def _level(self, place: int) -> int:
        return self.pairs[place - self._begun].level if place >= self._begun else 0

    def _add(self, pair: Pair) -> int:
        self.pairs.append(pair)
        return self._begun + len(self.pairs) - 1


def _layers(pairs: Sequence[Pair], begun: int) -> list[Layer]:
    """Runs of pairs of the same level and kind, which are in order."""
    found, start = [], 0
    for end in range(1, len(pairs) + 1):
        if end < len(pairs) and pairs[end][:2] == pairs[start][:2]:
            continue
        run = pairs[start:end]
        one, other = np.array([pair.one for pair in run]), np.array([pair.other for pair in run])
        found.append(Layer(pairs[start].part, one, other, begun + start, begun + end))
        start = end
    return found
