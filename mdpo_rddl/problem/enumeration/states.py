"""The states that are reachable within the horizon, found breadth first."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse

from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import GroundModel
from mdpo_rddl.problem.enumeration.packing import keys
from mdpo_rddl.problem.enumeration.successors import Expander, Successors

_FIRST_BATCH = 64
_MAX_BATCH = 8192
_BATCH_TRANSITIONS = 1_000_000
_BATCH_VALUES = 100_000_000


@dataclass(frozen=True)
class Enumeration:
    """A Markov decision process as arrays: S states, R rows (a state with an action).

    Attributes:
      model: that it comes from.
      states: packed [S, words]; the first one is initial.
      depth: number of steps after which each state is first reached [S].
      first_row: the rows of state s are those from `first_row[s]` to `first_row[s + 1]` [S + 1];
        none where the episode ends, or where the horizon does.
      action: of each row, its number in the model [R].
      reward: expected reward of each row [R].
      transitions: probability of each next state [R, S], sparse.
    """

    model: GroundModel
    states: np.ndarray
    depth: np.ndarray
    first_row: np.ndarray
    action: np.ndarray
    reward: np.ndarray
    transitions: sparse.csr_matrix


class _Index:
    """Numbers states in the order in which they are found."""

    def __init__(self, first: np.ndarray) -> None:
        self._states = first[np.newaxis].copy()
        self._keys = keys(self._states)
        self._numbers = np.zeros(1, np.int64)
        self.count = 1

    @property
    def states(self) -> np.ndarray:
        return self._states[: self.count]

    def numbers(self, states: np.ndarray) -> np.ndarray:
        """The number of each state [N], new ones included."""
        unique, where, inverse = np.unique(keys(states), return_index=True, return_inverse=True)
        places = np.searchsorted(self._keys, unique)
        inside = np.minimum(places, len(self._keys) - 1)
        is_new = self._keys[inside] != unique
        numbers = self._numbers[inside]
        numbers[is_new] = self.count + np.arange(np.count_nonzero(is_new))
        self._append(states[where[is_new]])
        self._keys = np.insert(self._keys, places[is_new], unique[is_new])
        self._numbers = np.insert(self._numbers, places[is_new], numbers[is_new])
        found = numbers[inverse.ravel()]
        if states.shape[1] > 1 and not np.array_equal(self._states[found], states):
            raise NotEnumerableError("two states with one key")
        return found

    def _append(self, states: np.ndarray) -> None:
        needed = self.count + len(states)
        if needed > len(self._states):
            room = np.zeros((max(needed, 2 * len(self._states)), states.shape[1]), np.uint64)
            room[: self.count] = self.states
            self._states = room
        self._states[self.count : needed] = states
        self.count = needed


class _Part(NamedTuple):
    """What one batch has added."""

    rows: np.ndarray  # number of rows of each of its states
    action: np.ndarray
    reward: np.ndarray
    transitions: sparse.csr_matrix


def enumerate_states(model: GroundModel, limits: EnumerationLimits) -> Enumeration:
    """Enumerates the states of a model.

    Raises:
      NotEnumerableError: if a limit is reached, or a state has no legal action.
    """
    expander = Expander(model, limits)
    index, parts, depths = _Index(model.initial), [], [np.zeros(1, np.int32)]
    largest = max(_FIRST_BATCH, min(_MAX_BATCH, _BATCH_VALUES // max(1, expander.operations)))
    batch, done, transitions = min(_FIRST_BATCH, largest), 0, 0
    for depth in range(model.horizon):
        end = index.count
        while done < end:
            limits.check_time()
            stop = min(end, done + batch)
            parts.append(_expand(expander, index, index.states[done:stop]))
            added = parts[-1].transitions.nnz
            transitions += added
            limits.check_transitions(transitions)
            limits.check_states(index.count)
            each = max(1.0, added / (stop - done))
            batch = int(np.clip(_BATCH_TRANSITIONS / each, 1, min(largest, 4 * batch)))
            done = stop
        depths.append(np.full(index.count - end, depth + 1, np.int32))
        if done == index.count:
            break
    return _joined(model, index.states, np.concatenate(depths), parts)


def _expand(expander: Expander, index: _Index, states: np.ndarray) -> _Part:
    alive = np.flatnonzero(~expander.ended(states))
    rows = np.zeros(len(states), np.int64)
    if not len(alive):
        empty = sparse.csr_matrix((0, index.count))
        return _Part(rows, np.zeros(0, np.int32), np.zeros(0), empty)
    found: Successors = expander.expand(states[alive])
    rows[alive] = np.bincount(found.state, minlength=len(alive))
    columns = index.numbers(found.states)
    shape = (len(found.state), index.count)
    matrix = sparse.csr_matrix((found.probability, (found.row, columns)), shape=shape)
    return _Part(rows, found.action, found.reward, matrix)


def _joined(
    model: GroundModel, states: np.ndarray, depth: np.ndarray, parts: list[_Part]
) -> Enumeration:
    count = len(states)
    rows = np.zeros(count, np.int64)
    expanded = np.concatenate([part.rows for part in parts])
    rows[: len(expanded)] = expanded
    starts = np.cumsum([0, *(part.transitions.nnz for part in parts)])
    pointers = [
        part.transitions.indptr[1:].astype(np.int64) + start
        for part, start in zip(parts, starts, strict=False)
    ]
    data = np.concatenate([part.transitions.data for part in parts])
    columns = np.concatenate([part.transitions.indices.astype(np.int32) for part in parts])
    row_ends = np.concatenate([np.zeros(1, np.int64), *pointers])
    matrix = sparse.csr_matrix((data, columns, row_ends), shape=(len(row_ends) - 1, count))
    return Enumeration(
        model=model,
        states=states.copy(),
        depth=depth,
        first_row=np.concatenate([np.zeros(1, np.int64), np.cumsum(rows)]),
        action=np.concatenate([part.action for part in parts]),
        reward=np.concatenate([part.reward for part in parts]),
        transitions=matrix,
    )
