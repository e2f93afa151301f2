"""The states that are reachable within the horizon, found breadth first."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import sparse

from mdpo_rddl.problem.enumeration.afterstates import Afterstates
from mdpo_rddl.problem.enumeration.index import StateIndex
from mdpo_rddl.problem.enumeration.irrelevance import Merge, find_merges, merged
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import GroundModel
from mdpo_rddl.problem.enumeration.pace import Pace, expected
from mdpo_rddl.problem.enumeration.rows import RowMaker

_FIRST_BATCH = 64
_MAX_BATCH = 8192
_BATCH_ROWS = 400_000
_BATCH_VALUES = 100_000_000
# as much memory as a few transitions each, and more while values are worked out
_MAX_ROWS = 60_000_000


class Transitions(Protocol):
    """Probabilities of next states: what a sparse matrix [E, S] can do."""

    def __matmul__(self, values: np.ndarray) -> np.ndarray:
        """The expectation [E] of the next states' values [S]."""

    @property
    def nnz(self) -> int:
        """Numbers that are stored."""


@dataclass(frozen=True)
class Enumeration:
    """A Markov decision process as arrays.

    There are S states, R rows (a state with an action) and E afterstates (how the next state
    is drawn).

    Attributes:
      model: that it comes from.
      merges: how states were joined; `states` holds one of each.
      states: packed [S, words]; the first one is initial.
      depth: number of steps after which each state is first reached [S].
      first_row: the rows of state s are those from `first_row[s]` to `first_row[s + 1]` [S + 1];
        none where the episode ends, or where the horizon does, or where no action is legal.
      action: of each row, its number in the model [R].
      reward: expected reward of each row [R].
      afterstate: number of each row's [R].
      transitions: probability of each next state after each afterstate [E, S].
      dead: whether no action is legal in a state in which the episode goes on [S].
    """

    model: GroundModel
    merges: list[Merge]
    states: np.ndarray
    depth: np.ndarray
    first_row: np.ndarray
    action: np.ndarray
    reward: np.ndarray
    afterstate: np.ndarray
    transitions: Transitions
    dead: np.ndarray


class Search:
    """What has been found up to now."""

    def __init__(self, model: GroundModel, limits: EnumerationLimits, follow: bool = True) -> None:
        """Starts at the initial state.

        Args:
          model: whose states are searched.
          limits: of the search.
          follow: whether next states are enumerated too, and states joined.
        """
        self.model, self.limits = model, limits
        self.merges = find_merges(model, limits) if follow else []
        self._follow = follow
        self.afterstates = Afterstates(model, limits)
        self.maker = RowMaker(model, self.afterstates)
        self.index = StateIndex(model.packing.words)
        self.after_index = StateIndex(self.afterstates.packing.words)
        self.row_counts: list[np.ndarray] = []
        self.dead: list[np.ndarray] = []
        self.rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self.transitions: list[sparse.csr_matrix] = []
        self.transition_count = 0
        self._row_count = 0
        self.index.numbers(merged(model.initial[np.newaxis], self.merges))

    def expand(self, states: np.ndarray) -> None:
        """Adds the rows of states, and whatever follows them."""
        self.limits.check_time()
        counts, goes_on = np.zeros(len(states), np.int64), ~self.maker.ended(states)
        alive = np.flatnonzero(goes_on)
        if len(alive):
            rows = self.maker.rows(states[alive])
            counts[alive] = np.bincount(rows.state, minlength=len(alive))
            known = self.after_index.count
            numbers = self.after_index.numbers(rows.afterstates)
            self.rows.append((rows.action, rows.reward, numbers))
            self._row_count += len(rows.state)
            if self._row_count > _MAX_ROWS:
                raise NotEnumerableError(f"more than {_MAX_ROWS:,} states with actions")
            if self._follow:
                self._draw(self.after_index.states[known:])
        self.row_counts.append(counts)
        self.dead.append(goes_on & (counts == 0))

    def _draw(self, afterstates: np.ndarray) -> None:
        for draws in self.afterstates.draw(afterstates) if len(afterstates) else ():
            self.limits.check_time()
            self.transition_count += len(draws.origin)
            self.limits.check_transitions(self.transition_count)
            columns = self.index.numbers(merged(draws.states, self.merges))
            self.limits.check_states(self.index.count)
            first = draws.origin.min()
            shape = (draws.origin.max() - first + 1, self.index.count)
            entries = (draws.probability, (draws.origin - first, columns))
            self.transitions.append(sparse.csr_matrix(entries, shape=shape))


def enumerate_states(model: GroundModel, limits: EnumerationLimits) -> Enumeration:
    """Enumerates the states of a model.

    Raises:
      NotEnumerableError: if a limit is reached, or if the states that wait cannot be expanded in
        time.
    """
    search, pace = Search(model, limits), Pace(limits)
    operations = max(1, search.maker.operations)
    largest = min(_MAX_BATCH, _BATCH_VALUES // operations, _BATCH_ROWS // len(model.actions))
    largest = max(_FIRST_BATCH, largest)
    index, depths, done, batch = search.index, [np.zeros(1, np.int32)], 0, _FIRST_BATCH
    for depth in range(model.horizon):
        begin, end, depths_left = done, index.count, model.horizon - depth - 1
        while done < end:
            stop = min(end, done + batch)
            search.expand(index.states[done:stop])
            done, batch = stop, min(largest, 4 * batch)
            # what the last step leads to is not expanded
            pace.check(done, (index.count if depths_left else end) - done)
        depths.append(np.full(index.count - end, depth + 1, np.int32))
        if done == index.count:
            break
        if depths_left:
            pace.check(done, expected(index.count - end, end - begin, depths_left - 1))
    transitions = _stacked(search.transitions, index.count)
    return joined(search, index.states.copy(), np.concatenate(depths), transitions)


def joined(
    search: Search, states: np.ndarray, depth: np.ndarray, transitions: Transitions
) -> Enumeration:
    """What a search has found, as arrays."""
    rows, dead = np.zeros(len(states), np.int64), np.zeros(len(states), bool)
    expanded = np.concatenate(search.row_counts)
    rows[: len(expanded)], dead[: len(expanded)] = expanded, np.concatenate(search.dead)
    empty = (np.zeros(0, np.int32), np.zeros(0), np.zeros(0, np.int64))
    action, reward, afterstate = map(np.concatenate, zip(empty, *search.rows, strict=True))
    return Enumeration(
        model=search.model,
        merges=search.merges,
        states=states,
        depth=depth,
        first_row=np.concatenate([np.zeros(1, np.int64), np.cumsum(rows)]),
        action=action,
        reward=reward,
        afterstate=afterstate,
        transitions=transitions,
        dead=dead,
    )


def _stacked(parts: list[sparse.csr_matrix], columns: int) -> sparse.csr_matrix:
    """The rows of all parts; they are taken out of the list, for the memory."""
    if not parts:
        return sparse.csr_matrix((0, columns))
    starts = np.cumsum([0, *(part.nnz for part in parts)])
    pointers = [
        part.indptr[1:].astype(np.int64) + start
        for part, start in zip(parts, starts[:-1], strict=True)
    ]
    ends = np.concatenate([np.zeros(1, np.int64), *pointers])
    data = np.concatenate([part.data for part in parts])
    indices = np.concatenate([part.indices.astype(np.int32) for part in parts])
    parts.clear()
    return sparse.csr_matrix((data, indices, ends), shape=(len(ends) - 1, columns))
