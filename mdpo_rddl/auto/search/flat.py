"""Parameters as vectors and back, by numpy: a program for that would cost more than it saves."""

import math
from typing import Any

import jax
import numpy as np


class Flat:
    """How a tree of arrays lies in a vector of D numbers."""

    def __init__(self, tree: Any) -> None:
        """Takes the arrays' shapes and kinds of numbers from a tree."""
        leaves, self._structure = jax.tree.flatten(tree)
        self._shapes = [np.shape(leaf) for leaf in leaves]
        self._dtypes = [np.asarray(leaf).dtype for leaf in leaves]
        self._ends = np.cumsum([math.prod(shape) for shape in self._shapes])[:-1]

    @staticmethod
    def vector(tree: Any) -> np.ndarray:
        """All numbers of a tree [D], in the order of its leaves."""
        leaves = [np.ravel(leaf) for leaf in jax.tree.leaves(tree)]
        return np.concatenate(leaves) if leaves else np.zeros(0)

    def tree(self, vectors: np.ndarray) -> Any:
        """Trees of vectors [..., D], whose arrays have the same leading axes."""
        parts = np.split(vectors, self._ends, axis=-1) if self._shapes else []
        leading = vectors.shape[:-1]
        leaves = [
            np.reshape(part, (*leading, *shape)).astype(dtype)
            for part, shape, dtype in zip(parts, self._shapes, self._dtypes, strict=True)
        ]
        return jax.tree.unflatten(self._structure, leaves)
