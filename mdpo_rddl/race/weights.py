"""Some of a feedback policy's parameters as a vector, which a search without a gradient varies."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

Params = dict[str, Any]


class Weights:
    """A view of parameters.

    Attributes:
      start: those that vary, as they are [D].
    """

    def __init__(self, params: Params, varies: Mapping[str, Any]) -> None:
        """Takes what varies out of a policy's parameters.

        Args:
          params: of one policy, nested dictionaries of arrays.
          varies: of some of them a mask of the same structure: True or an array of bools.
        """
        self._params = params
        self._places = [(path, _mask(mask, _at(params, path))) for path, mask in _leaves(varies)]
        parts = [np.asarray(_at(params, path), float)[mask] for path, mask in self._places]
        self.start = np.concatenate(parts) if parts else np.zeros(0)

    def params(self, vector: np.ndarray) -> Params:
        """The policy of a vector [D]."""
        return self._replaced(np.asarray(vector)[:, np.newaxis], lambda leaf: leaf[..., 0])

    def batch(self, vectors: np.ndarray, episodes: int) -> Params:
        """Policies of vectors [P, D] for P times so many replicas, a policy's side by side."""
        return self._replaced(
            np.asarray(vectors).T, lambda leaf: np.repeat(leaf, episodes, axis=-1)
        )

    def _replaced(self, columns: np.ndarray, made: Any) -> Params:
        """Parameters of policies [D, P]."""
        tree, first = _copied(self._params), 0
        for path, mask in self._places:
            leaf = _at(self._params, path)
            count = int(mask.sum())
            values = np.repeat(np.asarray(leaf)[..., np.newaxis], columns.shape[1], axis=-1)
            values[mask] = columns[first : first + count]
            first += count
            parent = _at(tree, path[:-1])
            parent[path[-1]] = made(values)
        return tree


def completed(params: Mapping[str, Any], full: Mapping[str, Any]) -> Params:
    """The parameters with what they leave out as another policy has it, which plays the no-op."""
    return {
        name: completed(params.get(name, {}), value)
        if isinstance(value, Mapping)
        else np.asarray(params.get(name, value), np.asarray(value).dtype)
        for name, value in full.items()
    }


def _leaves(tree: Mapping[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[Any, Any]]:
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, (*path, name))
        else:
            yield (*path, name), value


def _at(tree: Any, path: tuple[str, ...]) -> Any:
    for name in path:
        tree = tree[name]
    return tree


def _copied(tree: Mapping[str, Any]) -> dict[str, Any]:
    return {n: _copied(v) if isinstance(v, Mapping) else v for n, v in tree.items()}


def _mask(mask: Any, leaf: Any) -> np.ndarray:
    return np.broadcast_to(np.asarray(mask, bool), np.shape(leaf))
