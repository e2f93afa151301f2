"""Random numbers in common: what policies and actions are compared by."""

from typing import Any

import numpy as np


class CommonNumbers:
    """A generator whose draws are those of fewer episodes, which several replicas share.

    That holds of what is drawn without parameters, which most distributions are made from. Numbers
    of other distributions are independent, each with the parameters of its replica.
    """

    def __init__(self, generator: np.random.Generator, episodes: np.ndarray) -> None:
        """Draws nothing yet.

        Args:
          generator: makes the draws.
          episodes: number of the episode that each replica shares, from 0 [B].
        """
        self._generator, self._episodes = generator, episodes
        self._count = int(episodes.max(initial=-1)) + 1

    def random(self, size: tuple[int, int]) -> np.ndarray:
        """Uniform on [0, 1) [K, B]."""
        return self._generator.random((size[0], self._count))[:, self._episodes]

    def standard_normal(self, size: tuple[int, int]) -> np.ndarray:
        """[K, B]."""
        return self._generator.standard_normal((size[0], self._count))[:, self._episodes]

    def standard_exponential(self, size: tuple[int, int]) -> np.ndarray:
        """[K, B]."""
        return self._generator.standard_exponential((size[0], self._count))[:, self._episodes]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._generator, name)
