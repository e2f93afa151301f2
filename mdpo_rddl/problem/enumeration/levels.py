"""Afterstates: how each variable will be drawn, once a state and an action are known.

Many states and actions lead to the same draw, so that what follows is worked out once for
each afterstate. A variable that is never random stands in an afterstate with its value, any
other one with the number of its distribution, its level.
"""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.problem.enumeration.laws import Law
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import GroundModel
from mdpo_rddl.problem.enumeration.packing import Packing, pack

_MAX_LEVELS = 1024
_TOLERANCE = 1e-9
_CHUNK = 1_000_000


class Draws(NamedTuple):
    """Next states [M, words] of afterstates, each with its afterstate [M] and probability [M]."""

    origin: np.ndarray
    states: np.ndarray
    probability: np.ndarray


class Levels:
    """The distributions of one variable: each some values, with their probabilities."""

    def __init__(self) -> None:
        """Starts with none."""
        self._numbers: dict[tuple[float, ...], int] = {}
        self._tables: tuple[np.ndarray, np.ndarray] | None = None

    def of_bools(self, chances: np.ndarray) -> np.ndarray:
        """The level [N] of each chance of true [N]."""
        if np.all(chances == chances[:1]):
            return np.full(len(chances), self._add([1, 0, chances[0], 1 - chances[0]]))
        unique, inverse = np.unique(chances, return_inverse=True)
        return np.array([self._add([1, 0, each, 1 - each]) for each in unique])[inverse.ravel()]

    def of_rows(self, distributions: np.ndarray) -> np.ndarray:
        """The level [N] of each row of distributions [N, 2 B]: values, then probabilities."""
        unique, inverse = np.unique(distributions, axis=0, return_inverse=True)
        return np.array([self._add(row) for row in unique])[inverse.ravel()]

    @property
    def rows(self) -> list[tuple[float, ...]]:
        """All of them, in the order of their numbers: values, then probabilities."""
        return list(self._numbers)

    def know(self, number: int, row: tuple[float, ...]) -> None:
        """Gives a distribution the number that it has had before.

        Raises:
          ValueError: if it is none, or not the next one.
        """
        if not row or len(row) % 2 or self._add(row) != number:
            raise ValueError(f"its distribution {number} is none, or another one")

    def _add(self, row: Iterable[float]) -> int:
        number = self._numbers.setdefault(tuple(map(float, row)), len(self._numbers))
        if number >= _MAX_LEVELS:
            raise NotEnumerableError(f"a fluent with more than {_MAX_LEVELS} distributions")
        return number

    def tables(self) -> tuple[np.ndarray, np.ndarray]:
        """Values and probabilities of all levels, both [L, B]."""
        if self._tables is not None and len(self._tables[0]) == len(self._numbers):
            return self._tables
        widest = max(map(len, self._numbers)) // 2
        values, probabilities = np.zeros((2, len(self._numbers), widest))
        for row, number in self._numbers.items():
            half = len(row) // 2
            values[number, :half], probabilities[number, :half] = row[:half], row[half:]
        self._tables = values, probabilities
        return self._tables


class Afterstates:
    """Packs and draws afterstates.

    Attributes:
      packing: of the variables of an afterstate.
      is_random: whether each variable is random in some state, after some action.
    """

    def __init__(self, model: GroundModel, limits: EnumerationLimits) -> None:
        """Sees which variables are random in some state, after some action."""
        self._model, self._limits = model, limits
        rules = [action.laws for action in model.actions]
        self.is_random = [
            any(self._may_be_random(laws[number], is_bool) for laws in rules)
            for number, is_bool in enumerate(model.is_bool)
        ]
        self._levels = [Levels() for _ in model.variables]
        bits = [1 << place.bits for place in model.packing.places]
        self.packing: Packing = pack(
            [
                _MAX_LEVELS if random else size
                for random, size in zip(self.is_random, bits, strict=True)
            ]
        )

    def levels(self) -> list[list[tuple[float, ...]]]:
        """Of each variable its distributions so far, in the order of their numbers."""
        return [levels.rows for levels in self._levels]

    def know(self, levels: Iterable[tuple[int, tuple[float, ...]]]) -> None:
        """Numbers distributions as they were numbered before.

        Args:
          levels: pairs of a variable and a distribution of it, those of one variable in the order
            of their numbers.

        Raises:
          NotEnumerableError: if they are too many, or have values that do not fit.
          ValueError: if they are not those of such variables.
        """
        counts = [0] * len(self._levels)
        for variable, row in levels:
            if not 0 <= variable < len(counts) or not self.is_random[variable]:
                raise ValueError(f"its variable {variable} is not random")
            self._levels[variable].know(counts[variable], row)
            counts[variable] += 1
        for variable, count in enumerate(counts):
            if count:
                values, _ = self._levels[variable].tables()
                self._encoded(variable, values)

    def _may_be_random(self, law: Law, is_bool: bool) -> bool:
        graph = self._model.graph
        value = law[0].value
        is_certain = graph.is_bool[value] or (
            graph.is_constant(value) and graph.values[value] in (0, 1)
        )
        return len(law) > 1 or (is_bool and not is_certain)

    def encode(self, number: int, law: Law, of: Callable[[int], np.ndarray]) -> np.ndarray:
        """A variable's bits in its word of afterstates [N].

        Args:
          number: of the variable.
          law: of its next value.
          of: the values [N] of a node.
        """
        if self.is_random[number]:
            return self.packing.encode(number, self._level(number, law, of))
        values = of(law[0].value)
        if values.dtype.kind == "f" and np.any(values != np.round(values)):
            raise NotEnumerableError("a state that is no whole number")
        try:
            bits = self._model.packing.encode(number, values)
        except OverflowError as error:
            raise NotEnumerableError(str(error)) from error
        shift = self._model.packing.places[number].shift
        return (bits >> np.uint64(shift)) << np.uint64(self.packing.places[number].shift)

    def _level(self, number: int, law: Law, of: Callable[[int], np.ndarray]) -> np.ndarray:
        levels = self._levels[number]
        if self._model.is_bool[number]:
            return levels.of_bools(of(law[0].value).astype(float))
        values = [of(branch.value) for branch in law]
        probabilities = [of(branch.probability) for branch in law]
        return levels.of_rows(np.stack([*values, *probabilities], axis=1).astype(float))

    def draw(self, afterstates: np.ndarray) -> list[Draws]:
        """All next states of afterstates [N, words], in chunks.

        Raises:
          NotEnumerableError: if they are too many, or a probability is none.
        """
        tables = {
            number: (self.packing.decode(number, afterstates), *self._checked(number, afterstates))
            for number, random in enumerate(self.is_random)
            if random
        }
        counts = np.ones(len(afterstates))
        for levels, _, probabilities in tables.values():
            counts *= np.count_nonzero(probabilities > 0, axis=1)[levels]
        self._limits.check_transitions(int(min(counts.sum(), 1e18)))
        chunk = (np.cumsum(counts) - counts) // _CHUNK
        starts = np.flatnonzero(np.diff(chunk, prepend=-1))
        ends = np.append(starts[1:], len(afterstates))
        fixed = self._fixed(afterstates)
        return [
            self._draw(np.arange(*bounds), fixed, tables)
            for bounds in zip(starts, ends, strict=True)
        ]

    def outcomes(self, afterstates: np.ndarray) -> np.ndarray:
        """How many next states are possible after each of afterstates [N]."""
        counts = np.ones(len(afterstates))
        for number, is_random in enumerate(self.is_random):
            if is_random:
                level = self.packing.decode(number, afterstates)
                _, probabilities = self._checked(number, afterstates)
                counts *= np.count_nonzero(probabilities > 0, axis=1)[level]
        return counts

    def sample(
        self, afterstates: np.ndarray, random: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """A next state [N, words] of each afterstate [N, words], and its probability [N].

        Raises:
          NotEnumerableError: if a probability is none.
        """
        states, probability = self._fixed(afterstates), np.ones(len(afterstates))
        for number, is_random in enumerate(self.is_random):
            if is_random:
                level = self.packing.decode(number, afterstates)
                encoded, probabilities = self._checked(number, afterstates)
                ends = np.cumsum(probabilities[level], axis=1)
                drawn = random.random(len(level)) * ends[:, -1]
                branch = np.count_nonzero(ends[:, :-1] <= drawn[:, np.newaxis], axis=1)
                states[:, self._model.packing.places[number].word] |= encoded[level, branch]
                probability *= probabilities[level, branch]
        return states, probability

    def chances(self, number: int, afterstates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The level of a random bool in afterstates [N], and its chance of true at each [L]."""
        encoded, probabilities = self._checked(number, afterstates)
        chance = np.sum(probabilities * (encoded > 0), axis=1)
        return self.packing.decode(number, afterstates), chance

    def _checked(self, number: int, afterstates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, probabilities = self._levels[number].tables()
        used = probabilities[np.unique(self.packing.decode(number, afterstates))]
        is_law = (used >= -_TOLERANCE).all() and np.allclose(used.sum(axis=1), 1.0)
        if not is_law:
            raise NotEnumerableError("a probability outside of [0, 1]")
        encoded = self._encoded(number, values)
        return encoded, np.where(probabilities > 0, np.minimum(probabilities, 1.0), 0.0)

    def _encoded(self, number: int, values: np.ndarray) -> np.ndarray:
        """Values [L, B] of a variable as bits in its word [L, B]."""
        try:
            return self._model.packing.encode(number, values.ravel()).reshape(values.shape)
        except OverflowError as error:
            raise NotEnumerableError(str(error)) from error

    def _fixed(self, afterstates: np.ndarray) -> np.ndarray:
        """Next states [N, words] of which the random variables are still 0."""
        states = np.zeros((len(afterstates), self._model.packing.words), np.uint64)
        for number, place in enumerate(self._model.packing.places):
            if not self.is_random[number]:
                own = self.packing.places[number]
                bits = (afterstates[:, own.word] & own.mask) >> np.uint64(own.shift)
                states[:, place.word] |= bits << np.uint64(place.shift)
        return states

    def _draw(self, origin: np.ndarray, fixed: np.ndarray, tables: dict[int, Any]) -> Draws:
        states, probability = fixed[origin], np.ones(len(origin))
        for number, (levels, encoded, probabilities) in tables.items():
            word = self._model.packing.places[number].word
            level = levels[origin]
            parts = []
            for branch in range(encoded.shape[1]):
                chosen = np.flatnonzero(probabilities[level, branch])
                own = level[chosen]
                new = states[chosen]
                new[:, word] |= encoded[own, branch]
                weight = probability[chosen] * probabilities[own, branch]
                parts.append((origin[chosen], new, weight))
            origin, states, probability = map(np.concatenate, zip(*parts, strict=True))
        return Draws(origin, states, probability)
