"""Afterstates: how each variable will be drawn, once a state and an action are known.

Many states and actions lead to the same draw, so that what follows is worked out once for
each afterstate. A variable that is never random stands in an afterstate with its value, any
other one with the number of its distribution, its level; of a group of variables that are drawn
together the first one stands for all.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mdpo_rddl.problem.enumeration.joint import JointLaw
from mdpo_rddl.problem.enumeration.laws import Law
from mdpo_rddl.problem.enumeration.levels import MAX_JOINT_LEVELS, MAX_LEVELS, Levels
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import GroundModel
from mdpo_rddl.problem.enumeration.packing import Packing, pack

# numbers of distributions that are looked at together
_NUMBERS_TOGETHER = 10_000_000
_TOLERANCE = 1e-9
_CHUNK = 1_000_000


class Draws(NamedTuple):
    """Next states [M, words] of afterstates, each with its afterstate [M] and probability [M]."""

    origin: np.ndarray
    states: np.ndarray
    probability: np.ndarray


class _Table(NamedTuple):
    """All levels of a variable, or of a group of them.

    Attributes:
      source: the probabilities [L, B] as the levels have them.
      encoded: words, and the bits [L, B] of the values in each.
      probabilities: [L, B].
      ends: their sums up to each branch [L, B].
      is_law: whether they are probabilities [L].
    """

    source: np.ndarray
    encoded: list[tuple[int, np.ndarray]]
    probabilities: np.ndarray
    ends: np.ndarray
    is_law: np.ndarray


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
        grouped = {number for group in model.groups for number in group}
        self.is_random = [
            number in grouped or any(self._may_be_random(laws[number], is_bool) for laws in rules)
            for number, is_bool in enumerate(model.is_bool)
        ]
        # per variable that stands for itself or for a group, all that it stands for
        self._random: dict[int, tuple[int, ...]] = {
            number: (number,)
            for number, is_random in enumerate(self.is_random)
            if is_random and number not in grouped
        }
        self._random |= {group[0]: group for group in model.groups}
        self._random = dict(sorted(self._random.items()))
        self._levels = [
            Levels(len(self._random.get(number, (number,)))) for number in range(len(rules[0]))
        ]
        self._tables: dict[int, _Table] = {}
        self.packing: Packing = pack(
            [self._size(number) for number in range(len(model.packing.places))]
        )

    def _size(self, number: int) -> int:
        """How many values a variable's place in an afterstate has."""
        if not self.is_random[number]:
            return 1 << self._model.packing.places[number].bits
        if number not in self._random:
            return 1  # another one stands for it
        return MAX_LEVELS if len(self._random[number]) == 1 else MAX_JOINT_LEVELS

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

    def encode_group(
        self, law: JointLaw, of: Callable[[int], np.ndarray], group: int
    ) -> np.ndarray:
        """The bits of a group's first variable in its word of afterstates [N].

        Args:
          law: of the next values.
          of: the values [N] of a node.
          group: its number.
        """
        first = self._model.groups[group][0]
        columns = [of(branch.values[each]) for each in range(len(law[0].values)) for branch in law]
        columns += [of(branch.probability) for branch in law]
        together = max(1, _NUMBERS_TOGETHER // len(columns))
        levels = [
            self._levels[first].of_rows(
                np.stack([each[start : start + together] for each in columns], axis=1).astype(float)
            )
            for start in range(0, len(columns[0]), together)
        ]
        return self.packing.encode(first, np.concatenate(levels))

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
        tables = [self._checked(number, afterstates) for number in self._random]
        counts = np.ones(len(afterstates))
        for levels, table in tables:
            counts *= np.count_nonzero(table.probabilities, axis=1)[levels]
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
        for number in self._random:
            levels, table = self._checked(number, afterstates)
            counts *= np.count_nonzero(table.probabilities, axis=1)[levels]
        return counts

    def sample(
        self, afterstates: np.ndarray, random: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """A next state [N, words] of each afterstate [N, words], and its probability [N].

        Raises:
          NotEnumerableError: if a probability is none.
        """
        states, probability = self._fixed(afterstates), np.ones(len(afterstates))
        for number in self._random:
            levels, table = self._checked(number, afterstates)
            ends = table.ends[levels]
            drawn = random.random(len(levels)) * ends[:, -1]
            branch = (ends[:, :-1] <= drawn[:, np.newaxis]).sum(axis=1)
            for word, bits in table.encoded:
                states[:, word] |= bits[levels, branch]
            probability *= table.probabilities[levels, branch]
        return states, probability

    def chances(self, number: int, afterstates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The level of a random bool in afterstates [N], and its chance of true at each [L]."""
        levels, table = self._checked(number, afterstates)
        ((_, encoded),) = table.encoded
        return levels, np.sum(table.probabilities * (encoded > 0), axis=1)

    def _checked(self, number: int, afterstates: np.ndarray) -> tuple[np.ndarray, _Table]:
        """The level [N] of a variable in each of afterstates, and the table of all levels.

        Raises:
          NotEnumerableError: if a probability is none.
        """
        table, levels = self._table(number), self.packing.decode(number, afterstates)
        if not table.is_law[levels].all():
            raise NotEnumerableError("a probability outside of [0, 1]")
        return levels, table

    def _table(self, number: int) -> _Table:
        """Of the levels of a variable, or of the group that it stands for; new ones are added.

        Raises:
          NotEnumerableError: if a value does not fit.
        """
        values, source = self._levels[number].tables()
        known = self._tables.get(number)
        if known is not None and known.source is source:
            return known
        encoded: dict[int, np.ndarray] = {}
        for variable, own in zip(self._random[number], values, strict=True):
            word = self._model.packing.places[variable].word
            try:
                bits = self._model.packing.encode(variable, own.ravel()).reshape(own.shape)
            except OverflowError as error:
                raise NotEnumerableError(str(error)) from error
            encoded[word] = encoded[word] | bits if word in encoded else bits
        is_law = (source >= -_TOLERANCE).all(axis=1) & np.isclose(source.sum(axis=1), 1.0)
        probabilities = np.where(source > 0, np.minimum(source, 1.0), 0.0)
        ends = np.cumsum(probabilities, axis=1)
        table = _Table(source, list(encoded.items()), probabilities, ends, is_law)
        self._tables[number] = table
        return table

    def _fixed(self, afterstates: np.ndarray) -> np.ndarray:
        """Next states [N, words] of which the random variables are still 0."""
        states = np.zeros((len(afterstates), self._model.packing.words), np.uint64)
        for number, place in enumerate(self._model.packing.places):
            if not self.is_random[number]:
                own = self.packing.places[number]
                bits = (afterstates[:, own.word] & own.mask) >> np.uint64(own.shift)
                states[:, place.word] |= bits << np.uint64(place.shift)
        return states

    def _draw(
        self, origin: np.ndarray, fixed: np.ndarray, tables: list[tuple[np.ndarray, _Table]]
    ) -> Draws:
        states, probability = fixed[origin], np.ones(len(origin))
        for levels, table in tables:
            level, probabilities = levels[origin], table.probabilities
            parts = []
            for branch in range(probabilities.shape[1]):
                chosen = np.flatnonzero(probabilities[level, branch])
                own = level[chosen]
                new = states[chosen]
                for word, bits in table.encoded:
                    new[:, word] |= bits[own, branch]
                weight = probability[chosen] * probabilities[own, branch]
                parts.append((origin[chosen], new, weight))
            origin, states, probability = map(np.concatenate, zip(*parts, strict=True))
        return Draws(origin, states, probability)
