"""Numbers for packed states."""

from dataclasses import dataclass

import numpy as np

from mdpo_rddl.problem.enumeration.limits import NotEnumerableError
from mdpo_rddl.problem.enumeration.packing import keys

# of the states: as many recent ones are put among the others at once, for that moves them all
_RECENT_SHARE = 1 / 16
_LEAST_RECENT = 4096


@dataclass(frozen=True)
class _Sorted:
    """Keys in order, and their numbers."""

    keys: np.ndarray
    numbers: np.ndarray

    def find(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The number of each key, -1 where it is not known, and where it would stand."""
        places = np.searchsorted(self.keys, wanted)
        if not len(self.keys):
            return np.full(len(wanted), -1), places
        inside = np.minimum(places, len(self.keys) - 1)
        return np.where(self.keys[inside] == wanted, self.numbers[inside], -1), places

    def inserted(self, places: np.ndarray, keys: np.ndarray, numbers: np.ndarray) -> "_Sorted":
        """With others at the places that `find` says."""
        return _Sorted(np.insert(self.keys, places, keys), np.insert(self.numbers, places, numbers))


_NONE = _Sorted(np.zeros(0, np.uint64), np.zeros(0, np.int64))


class StateIndex:
    """Numbers packed states in the order in which they are found.

    Attributes:
      count: of the states.
    """

    def __init__(self, words: int) -> None:
        """Starts with none.

        Args:
          words: of a state.
        """
        self._states = np.zeros((1024, words), np.uint64)
        self._settled = self._recent = _NONE
        self.count = 0

    @property
    def states(self) -> np.ndarray:
        """All of them [count, words], in the order of their numbers."""
        return self._states[: self.count]

    def numbers(self, states: np.ndarray) -> np.ndarray:
        """The number [N] of each state [N, words], new ones included.

        Raises:
          NotEnumerableError: if two states have one key.
        """
        unique, where, inverse = np.unique(keys(states), return_index=True, return_inverse=True)
        numbers, _ = self._settled.find(unique)
        recent, places = self._recent.find(unique)
        numbers = np.maximum(numbers, recent)
        is_new = numbers < 0
        numbers[is_new] = self.count + np.arange(np.count_nonzero(is_new))
        self._append(states[where[is_new]])
        self._recent = self._recent.inserted(places[is_new], unique[is_new], numbers[is_new])
        if len(self._recent.keys) > max(_LEAST_RECENT, _RECENT_SHARE * self.count):
            self._settle()
        found = numbers[inverse.ravel()]
        if states.shape[1] > 1 and not np.array_equal(self._states[found], states):
            raise NotEnumerableError("two states with one key")
        return found

    def known(self, states: np.ndarray) -> np.ndarray:
        """The number [N] of each state [N, words]; -1 where it is not known."""
        wanted = keys(states)
        return np.maximum(self._settled.find(wanted)[0], self._recent.find(wanted)[0])

    def _settle(self) -> None:
        recent = self._recent
        _, places = self._settled.find(recent.keys)
        self._settled = self._settled.inserted(places, recent.keys, recent.numbers)
        self._recent = _NONE

    def _append(self, states: np.ndarray) -> None:
        needed = self.count + len(states)
        if needed > len(self._states):
            room = np.zeros((max(needed, 2 * len(self._states)), states.shape[1]), np.uint64)
            room[: self.count] = self.states
            self._states = room
        self._states[self.count : needed] = states
        self.count = needed
