"""Arrays that grow at their ends."""

from typing import Any

import numpy as np


class Growing:
    """An array [N] with room to grow."""

    def __init__(self, dtype: Any, room: int = 1024) -> None:
        """Starts empty.

        Args:
          dtype: of the entries.
          room: for how many entries at first.
        """
        self._array = np.zeros(room, dtype)
        self.count = 0

    @property
    def values(self) -> np.ndarray:
        """The entries [N]: a view, of no use once something was added."""
        return self._array[: self.count]

    def add(self, values: np.ndarray) -> None:
        """Adds entries [M] at the end."""
        end = self.count + len(values)
        if end > len(self._array):
            room = np.zeros(max(end, 2 * len(self._array)), self._array.dtype)
            room[: self.count] = self.values
            self._array = room
        self._array[self.count : end] = values
        self.count = end
