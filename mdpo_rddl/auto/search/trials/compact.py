"""Whole numbers and distributions as small arrays, which are checked when they are read."""

from collections.abc import Sequence

import numpy as np

from mdpo_rddl.auto.common.state import State


def small(numbers: np.ndarray) -> np.ndarray:
    """Whole numbers [N] that are not below 0, in the smallest type that holds them all."""
    return numbers.astype(np.min_scalar_type(int(numbers.max(initial=0))))


def read_numbers(state: State, name: str, count: int | None, most: int) -> np.ndarray:
    """What `small` has made [N].

    Args:
      state: that has them.
      name: of them.
      count: how many they are; None for any number.
      most: none is larger.

    Raises:
      KeyError, ValueError: if they are not such numbers.
    """
    numbers = state.array(name, (count,))
    if numbers.dtype.kind != "u" or np.any(numbers > most):
        raise ValueError(f"its {name} are no whole numbers from 0 to {most}")
    return numbers.astype(np.int64)


def level_state(levels: Sequence[Sequence[tuple[float, ...]]]) -> State:
    """The distributions of each variable, of different lengths."""
    pairs = [(variable, row) for variable, rows in enumerate(levels) for row in rows]
    return State(
        {
            "variables": small(np.array([variable for variable, _ in pairs], np.int64)),
            "lengths": small(np.array([len(row) for _, row in pairs], np.int64)),
            "numbers": np.array([number for _, row in pairs for number in row], float),
        }
    )


def read_levels(state: State) -> list[tuple[int, tuple[float, ...]]]:
    """Each distribution with its variable, in the order in which `level_state` was given them.

    Raises:
      KeyError, ValueError: if they are none.
    """
    numbers = state.array("numbers", (None,))
    lengths = read_numbers(state, "lengths", None, len(numbers))
    variables = read_numbers(state, "variables", len(lengths), np.iinfo(np.int32).max)
    if lengths.sum() != len(numbers):
        raise ValueError(f"its {len(numbers)} numbers are {lengths.sum()} by their lengths")
    rows = np.split(numbers, np.cumsum(lengths)[:-1])
    return [(int(one), tuple(row.tolist())) for one, row in zip(variables, rows, strict=True)]
