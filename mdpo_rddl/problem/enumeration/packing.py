"""Discrete ground variables packed into words of 64 bits."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

_WORD = 64
_INT_BITS = 16
_INT_OFFSET = 1 << (_INT_BITS - 1)


class Place(NamedTuple):
    """Where a variable stands: bits from `shift` of a word hold its value plus an offset."""

    word: int
    shift: int
    bits: int
    offset: int

    @property
    def mask(self) -> np.uint64:
        """The bits of the variable in its word."""
        return np.uint64(((1 << self.bits) - 1) << self.shift)


class Packing(NamedTuple):
    """The places of variables, none of which crosses the end of a word."""

    places: tuple[Place, ...]

    @property
    def words(self) -> int:
        """Number of words of a state."""
        return self.places[-1].word + 1 if self.places else 1

    def encode(self, variable: int, values: np.ndarray) -> np.ndarray:
        """Values [N] as bits in the variable's word [N].

        Raises:
          OverflowError: if a value does not fit.
        """
        place = self.places[variable]
        shifted = np.asarray(values).astype(np.int64) + place.offset
        # of a negative number the bits that are shifted in are 1
        if (shifted >> place.bits).any():
            raise OverflowError("a value that does not fit in its bits")
        return shifted.astype(np.uint64) << np.uint64(place.shift)

    def decode(self, variable: int, states: np.ndarray) -> np.ndarray:
        """A variable's values [N] in states [N, words]: bools where it has one bit."""
        place = self.places[variable]
        bits = (states[:, place.word] & place.mask) >> np.uint64(place.shift)
        return bits.astype(bool) if place.bits == 1 else bits.astype(np.int64) - place.offset

    def encode_all(self, values: Sequence[int]) -> np.ndarray:
        """One state [words] of the values of all variables."""
        state = np.zeros(self.words, np.uint64)
        for variable, value in enumerate(values):
            state[self.places[variable].word] |= self.encode(variable, np.array([value]))[0]
        return state


def pack(sizes: Sequence[int | None]) -> Packing:
    """Places for variables with values 0 to size - 1; None stands for an int of 16 bits."""
    places, word, used = [], 0, 0
    for size in sizes:
        bits = _INT_BITS if size is None else max(1, int(size - 1).bit_length())
        if used + bits > _WORD:
            word, used = word + 1, 0
        places.append(Place(word, used, bits, _INT_OFFSET if size is None else 0))
        used += bits
    return Packing(tuple(places))


def keys(states: np.ndarray) -> np.ndarray:
    """A key [N] for each state [N, words]; equal states have equal keys."""
    key = states[:, 0].copy()
    for word in range(1, states.shape[1]):
        key = _mixed(key) + states[:, word]
    return key


def _mixed(key: np.ndarray) -> np.ndarray:
    """A bijection of words in which every bit depends on every bit (splitmix64's finaliser)."""
    key = key + np.uint64(0x9E3779B97F4A7C15)
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return key ^ (key >> np.uint64(31))


def sizes_of(ranges: Sequence[str], objects: Mapping[str, Sequence[str]]) -> list[int | None]:
    """The number of values of each range: of bools 2, of ints None, else of a type's objects.

    Raises:
      KeyError: for another range, as of reals.
    """
    known: dict[str, int | None] = {"bool": 2, "int": None}
    return [known[each] if each in known else len(objects[each]) for each in ranges]
