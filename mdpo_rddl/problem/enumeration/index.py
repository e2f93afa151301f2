"""Numbers for packed states."""

import numpy as np

from mdpo_rddl.problem.enumeration.limits import NotEnumerableError
from mdpo_rddl.problem.enumeration.packing import keys


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
        self._keys = np.zeros(0, np.uint64)
        self._numbers = np.zeros(0, np.int64)
        self.count = 0

    @classmethod
    def of(cls, states: np.ndarray) -> "StateIndex":
        """One that has numbered states [N, words] in their order.

        Raises:
          ValueError: if two of them are equal.
        """
        index = cls(states.shape[1])
        index._append(states)
        of_states = keys(states)
        index._numbers = np.argsort(of_states, kind="stable")
        index._keys = of_states[index._numbers]
        if np.any(index._keys[1:] == index._keys[:-1]):
            raise ValueError("two of its states are equal")
        return index

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
        places = np.searchsorted(self._keys, unique)
        is_new = np.ones(len(unique), bool)
        inside = places < len(self._keys)
        is_new[inside] = self._keys[places[inside]] != unique[inside]
        numbers = np.empty(len(unique), np.int64)
        numbers[~is_new] = self._numbers[places[~is_new]]
        numbers[is_new] = self.count + np.arange(np.count_nonzero(is_new))
        self._append(states[where[is_new]])
        self._keys = np.insert(self._keys, places[is_new], unique[is_new])
        self._numbers = np.insert(self._numbers, places[is_new], numbers[is_new])
        found = numbers[inverse.ravel()]
        if states.shape[1] > 1 and not np.array_equal(self._states[found], states):
            raise NotEnumerableError("two states with one key")
        return found

    def known(self, states: np.ndarray) -> np.ndarray:
        """The number [N] of each state [N, words]; -1 where it is not known."""
        if not self.count:
            return np.full(len(states), -1)
        wanted = keys(states)
        places = np.minimum(np.searchsorted(self._keys, wanted), len(self._keys) - 1)
        return np.where(self._keys[places] == wanted, self._numbers[places], -1)

    def _append(self, states: np.ndarray) -> None:
        needed = self.count + len(states)
        if needed > len(self._states):
            room = np.zeros((max(needed, 2 * len(self._states)), states.shape[1]), np.uint64)
            room[: self.count] = self.states
            self._states = room
        self._states[self.count : needed] = states
        self.count = needed
