"""Some entries of an array for each row of a result, gathered."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array, core


@dataclass(frozen=True)
class Entries:
    """Some entries of an array [*kept, K], K for each of what is left after a reduction.

    Attributes:
      axes: per axis of the array where these are, of shapes that are broadcast to `shape`.
      moves: per axis of the array whether that depends on K.
      shape: [*kept, K].
    """

    axes: tuple[np.ndarray, ...]
    moves: tuple[bool, ...]
    shape: tuple[int, ...]

    def within(self, sizes: Sequence[int]) -> "Entries":
        """Of an array that has one entry along some axes, which is meant everywhere."""
        only = np.zeros((), int)
        axes = (only if size == 1 else own for size, own in zip(sizes, self.axes, strict=True))
        moves = (size > 1 and own for size, own in zip(sizes, self.moves, strict=True))
        return Entries(tuple(axes), tuple(moves), self.shape)


def gathered(operand: Any, entries: Entries) -> Any:
    """Entries of an operand, of a shape that is broadcast to theirs.

    Args:
      operand: an array, traced or not; a number is given as it is.
      entries: of it.
    """
    if isinstance(operand, core.Tracer):
        return _of_traced(operand, entries)
    return np.asarray(operand)[entries.axes] if entries.axes else operand


def _of_traced(operand: Array, entries: Entries) -> Array:
    chosen = [axis for axis, moves in enumerate(entries.moves) if moves]
    varying = {
        place
        for axis in chosen
        for place, size in enumerate(np.shape(entries.axes[axis]))
        if size > 1
    }
    # of the others those are taken whole that the chosen ones do not depend on
    sliced = dict[int, int]()
    for axis, own in enumerate(entries.axes):
        place = int(np.argmax(np.shape(own))) if np.ndim(own) else -1
        if axis not in chosen and np.size(own) > 1:
            if place in varying:
                chosen.append(axis)
            else:
                sliced[axis] = place
    dropped = [axis for axis in range(operand.ndim) if axis not in chosen and axis not in sliced]
    order = [*sliced, *chosen, *dropped]
    last = tuple(range(len(order) - len(dropped), len(order)))
    values = jnp.squeeze(jnp.transpose(operand, order), last)
    sizes = [1] * len(entries.shape)
    for axis, place in sliced.items():
        sizes[place] = operand.shape[axis]
    places = list(sliced.values())
    if chosen:
        wide = np.broadcast_arrays(*(entries.axes[axis] for axis in chosen))
        where = [np.squeeze(each, tuple(places)) for each in wide]
        index = (*(slice(None) for _ in sliced), *where)
        values = values.at[index].get(mode="promise_in_bounds")
        others = [place for place in range(len(sizes)) if place not in places]
        for place, size in zip(others, where[0].shape, strict=True):
            sizes[place] = size
        places += others
    return jnp.reshape(jnp.transpose(values, np.argsort(places).tolist()), sizes)


def shrunk(values: np.ndarray) -> np.ndarray:
    """One value for each axis along which all are the same."""
    for axis in range(values.ndim):
        first = np.take(values, [0], axis)
        if np.array_equal(np.broadcast_to(first, values.shape), values):
            values = first
    return values
