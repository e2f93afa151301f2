"""Bools that are all random: every state is reachable, and next values are independent.

The expectation over next states is then a tensor contraction, one variable at a time, where a
list of all successors would be too long.
"""

from dataclasses import dataclass

import numpy as np

from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import GroundModel
from mdpo_rddl.problem.enumeration.states import Enumeration, Search, joined

_MAX_VARIABLES = 20
_MAX_CELLS_PER_STATE = 16  # beyond, a list of successors is shorter
_MAX_ROWS = 20_000_000
_BATCH = 4096
_SAMPLE = 2048
_NOT_RANDOM = "not all of few fluents are random bools"


@dataclass(frozen=True)
class FactoredTransitions:
    """Probabilities of next states after E afterstates, as a product over V bools.

    Attributes:
      chances: per variable the chance of true at each of its levels [L_v].
      cells: of each afterstate, its place among all combinations of levels [E].
      initial: the packed initial state; state s is packed as s XOR it.
    """

    chances: list[np.ndarray]
    cells: np.ndarray
    initial: int

    def __matmul__(self, values: np.ndarray) -> np.ndarray:
        """The expectation [E] of the next states' values [2^V]."""
        order = np.arange(len(values)) ^ self.initial
        # the last variable has the highest bit, which is the first axis
        tensor = values[order].reshape((2,) * len(self.chances))
        for chance in reversed(self.chances):
            mixed = np.multiply.outer(1 - chance, tensor[0]) + np.multiply.outer(chance, tensor[1])
            tensor = np.moveaxis(mixed, 0, -1)
        return tensor.ravel()[self.cells]

    @property
    def nnz(self) -> int:
        """Numbers that are stored."""
        return len(self.cells) + sum(map(len, self.chances))


def enumerate_factored(model: GroundModel, limits: EnumerationLimits) -> Enumeration:
    """Enumerates all states of a model of random bools.

    Raises:
      NotEnumerableError: for another model, or one that is too large.
    """
    count = len(model.variables)
    if count > _MAX_VARIABLES or not all(model.is_bool) or model.groups:
        raise NotEnumerableError(_NOT_RANDOM)
    if len(model.actions) << count > _MAX_ROWS:
        raise NotEnumerableError(f"more than {_MAX_ROWS:,} states with actions")
    search = Search(model, limits, follow=False)  # takes seconds where the laws are large
    if not all(search.afterstates.is_random):
        raise NotEnumerableError(_NOT_RANDOM)
    initial = int(model.initial[0])
    states = (np.arange(1 << count) ^ initial).astype(np.uint64)[:, np.newaxis]
    if len(states) > _SAMPLE:
        # the levels of a few states tell whether there are too many, before all are expanded
        sample = Search(model, limits, follow=False)
        sample.expand(np.random.default_rng(0).choice(states, _SAMPLE, replace=False))
        _cells(sample, len(states))
    for start in range(0, len(states), _BATCH):
        search.expand(states[start : start + _BATCH])
    chances, cells = _cells(search, len(states))
    transitions = FactoredTransitions(chances, cells, initial)
    return joined(search, states, np.zeros(len(states), np.int32), transitions)


def _cells(search: Search, states: int) -> tuple[list[np.ndarray], np.ndarray]:
    """The chances and cells of `FactoredTransitions`, of what was expanded.

    Raises:
      NotEnumerableError: if there are too many combinations for so many states.
    """
    chances: list[np.ndarray] = []
    cells, size = np.zeros(search.after_index.count, np.int64), 1
    for number in reversed(range(len(search.model.variables))):
        levels, chance = search.afterstates.chances(number, search.after_index.states)
        cells, size = cells * len(chance) + levels, size * len(chance)
        chances.insert(0, chance)
        if size > _MAX_CELLS_PER_STATE * states:
            raise NotEnumerableError("many combinations of distributions")
    return chances, cells
