"""Random numbers in common: what policies are compared by."""

from typing import Any

import numpy as np


class CommonNumbers:
    """A generator whose draws are the same in each of several groups of replicas, side by side.

    That holds of what is drawn without parameters, which most distributions are made from. Numbers
    of other distributions are independent, each with the parameters of its replica.
    """

    def __init__(self, generator: np.random.Generator, groups: int) -> None:
        """Draws nothing yet.

        Args:
          generator: makes the draws of a group.
          groups: how many; they divide the number of replicas.
        """
        self._generator, self._groups = generator, groups

    def random(self, size: tuple[int, int]) -> np.ndarray:
        """Uniform on [0, 1) [K, B]."""
        return self._common(self._generator.random, size)

    def standard_normal(self, size: tuple[int, int]) -> np.ndarray:
        """[K, B]."""
        return self._common(self._generator.standard_normal, size)

    def standard_exponential(self, size: tuple[int, int]) -> np.ndarray:
        """[K, B]."""
        return self._common(self._generator.standard_exponential, size)

    def _common(self, draw: Any, size: tuple[int, int]) -> np.ndarray:
        return np.tile(draw((size[0], size[1] // self._groups)), self._groups)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._generator, name)
