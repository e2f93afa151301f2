"""What an arm needs to go on in another process: arrays, and values that JSON can hold."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

UNFIT = (ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError)
"""What is raised by a state that is not of this problem, or that somebody has changed."""


@dataclass(frozen=True, eq=False)
class State:
    """A flat state.

    Attributes:
      tensors: by their names, which may have slashes.
      values: as JSON can hold them, infinities included.
    """

    tensors: Mapping[str, np.ndarray]
    values: Mapping[str, Any] = field(default_factory=dict)

    @property
    def bytes(self) -> int:
        """Of all tensors."""
        return sum(tensor.nbytes for tensor in self.tensors.values())

    def array(self, name: str, shape: tuple[int | None, ...]) -> np.ndarray:
        """A tensor of numbers, of any length where the shape has None.

        Raises:
          KeyError: if there is none of that name.
          ValueError: naming it, if it has another shape, or a number that is not finite.
        """
        found = self.tensors[name]
        fits = len(found.shape) == len(shape) and found.dtype.kind in "fiub"
        fits = fits and all(w is None or w == f for f, w in zip(found.shape, shape, strict=True))
        if not fits or not np.isfinite(found).all():
            raise ValueError(f"its {name} is {found.dtype}{list(found.shape)}, or not finite")
        # what is kept must not be written to
        return found.copy()

    def part(self, prefix: str) -> "State":
        """What `within` has put together under a prefix."""
        start = f"{prefix}/"
        return State(
            {n.removeprefix(start): v for n, v in self.tensors.items() if n.startswith(start)},
            dict(self.values[prefix]),
        )

    def within(self, prefix: str) -> "State":
        """The same under a prefix, to be put together with others by `joined`."""
        tensors = {f"{prefix}/{name}": value for name, value in self.tensors.items()}
        return State(tensors, {prefix: dict(self.values)})


def joined(*states: State) -> State:
    """One state of several, whose names must differ."""
    tensors: dict[str, np.ndarray] = {}
    values: dict[str, Any] = {}
    for state in states:
        tensors |= state.tensors
        values |= state.values
    return State(tensors, values)


def count_of(value: Any) -> int:
    """A number of something, that was read.

    Raises:
      TypeError, ValueError: if it is none.
    """
    count = int(value)
    if count != value or count < 0:
        raise ValueError(f"{value!r:.40} is no number of anything")
    return count


def generator_place(random: np.random.Generator) -> dict[str, Any]:
    """Where a generator is, as JSON can hold it."""
    return dict(random.bit_generator.state)


def set_generator(random: np.random.Generator, values: Mapping[str, Any]) -> None:
    """Puts a generator where another one was.

    Raises:
      KeyError, OverflowError, TypeError, ValueError: if that is no such place.
    """
    random.bit_generator.state = dict(values)
