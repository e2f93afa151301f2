"""Levels: the distributions that a variable has had so far, each with a number."""

from collections.abc import Iterable

import numpy as np

from mdpo_rddl.problem.enumeration.limits import NotEnumerableError

MAX_LEVELS, MAX_JOINT_LEVELS = 2**18, 2**14
"""How many one variable may have, and some that are drawn together."""
# numbers in all distributions of some variables
_MAX_NUMBERS = 2_000_000


class Levels:
    """The distributions of one variable, or of some that are drawn together.

    Each is a tuple of numbers: first all values of each variable, then their probabilities.
    """

    def __init__(self, variables: int = 1) -> None:
        """Starts with none.

        Args:
          variables: number G of them.
        """
        self._most = MAX_LEVELS if variables == 1 else MAX_JOINT_LEVELS
        self._parts = 1 + variables
        self._numbers: dict[tuple[float, ...], int] = {}
        # of some that were given with the same value several times
        self._joined: dict[tuple[float, ...], int] = {}
        # of the levels when they were last asked for, and what was added since
        self._tables = np.zeros((variables, 0, 0)), np.zeros((0, 0))
        self._new: list[tuple[float, ...]] = []

    def of_bools(self, chances: np.ndarray) -> np.ndarray:
        """The level [N] of each chance of true [N]."""
        if np.all(chances == chances[:1]):
            return np.full(len(chances), self._add([1, 0, chances[0], 1 - chances[0]]))
        unique, inverse = np.unique(chances, return_inverse=True)
        return np.array([self._add([1, 0, each, 1 - each]) for each in unique])[inverse.ravel()]

    def of_rows(self, distributions: np.ndarray) -> np.ndarray:
        """The level [N] of each row of distributions [N, (G + 1) B]."""
        unique, inverse = np.unique(distributions, axis=0, return_inverse=True)
        return np.array([self._add(row) for row in unique])[inverse.ravel()]

    def _add(self, row: Iterable[float]) -> int:
        given = tuple(map(float, row))
        known = self._numbers.get(given, self._joined.get(given))
        if known is not None:
            return known
        key = self._with_joined_branches(given)
        number = self._numbers.get(key, len(self._numbers))
        if number >= self._most:
            raise NotEnumerableError(f"a fluent with more than {self._most} distributions")
        if number * len(key) > _MAX_NUMBERS:
            raise NotEnumerableError("fluents with many distributions of many values together")
        if number == len(self._numbers):
            self._new.append(key)
        self._numbers[key] = number
        if key != given and len(self._joined) < self._most:
            self._joined[given] = number
        return number

    def _with_joined_branches(self, row: tuple[float, ...]) -> tuple[float, ...]:
        """The distribution with each of its values once.

        A next state that is drawn then has its whole probability, not that of one branch.
        """
        branches = len(row) // self._parts
        probabilities: dict[tuple[float, ...], float] = {}
        for branch in range(branches):
            *values, probability = row[branch::branches]
            place = tuple(values)
            probabilities[place] = probabilities.get(place, 0.0) + probability
        if len(probabilities) == branches:
            return row
        columns = zip(*probabilities, strict=True)
        return (*(value for column in columns for value in column), *probabilities.values())

    def tables(self) -> tuple[np.ndarray, np.ndarray]:
        """Values [G, L, B] and probabilities [L, B] of all levels; new arrays if some are new."""
        known = self._tables[1].shape
        if self._new:
            rows = [np.reshape(row, (self._parts, -1)) for row in self._new]
            widest = max(known[1], *(each.shape[1] for each in rows))
            table = np.zeros((self._parts, len(self._numbers), widest))
            table[:-1, : known[0], : known[1]], table[-1, : known[0], : known[1]] = self._tables
            # of what has fewer branches the others have no probability
            for number, each in enumerate(rows, start=known[0]):
                table[:, number, : each.shape[1]] = each
            self._tables = table[:-1], table[-1]
            self._new.clear()
        return self._tables
