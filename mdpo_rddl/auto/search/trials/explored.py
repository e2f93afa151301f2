"""What trials have seen of a ground model: states, what may be done there, and what followed."""

from collections.abc import Callable, Iterator

import numpy as np

from mdpo_rddl.auto.search.trials.growing import Growing
from mdpo_rddl.problem.enumeration.afterstates import Afterstates, Draws
from mdpo_rddl.problem.enumeration.index import StateIndex
from mdpo_rddl.problem.enumeration.irrelevance import find_merges, merged
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits
from mdpo_rddl.problem.enumeration.model import GroundModel
from mdpo_rddl.problem.enumeration.rows import NO_ROWS, RowMaker, Rows, with_rows

NEVER = np.iinfo(np.int32).max
"""The depth of a state that was not reached from the initial one yet."""
# next states after an afterstate that are all added with the first that is drawn
_FEW = 4
# rows that are made together, if all actions are legal
_ROWS_TOGETHER = 500_000


class Explored:
    """A part of a Markov decision process, which grows.

    As in an `Enumeration` there are S states, R rows (a state with an action) and E afterstates;
    of the next states after an afterstate only those are known that a trial has drawn.

    What is given for each of something grows with it: the entries are its `values`.

    Attributes:
      model: that it is a part of.
      merges: how states are joined.
      afterstates: draws next states.
      maker: makes the rows of states.
      index: of the states; the first one is initial.
      depth: least number of steps after which each state was reached [S].
      visits: of each state by trials [S].
      first_row, row_count: the rows of each state [S]; none where the episode has ended.
      action, reward, afterstate, tried: of each row its number in the model, its expected reward,
        its afterstate, and how often a trial has chosen it [R].
      idle: reward of the default action in the state from which each afterstate was first
        found [E]; where that is illegal, of the first action that is not.
      origin, next, probability: of each drawn transition its afterstate, the next state and its
        probability [T].
    """

    def __init__(self, model: GroundModel, limits: EnumerationLimits) -> None:
        """Knows the initial state.

        Raises:
          NotEnumerableError: if it has no legal action, or there is too little time.
        """
        self.model = model
        self.merges = find_merges(model, limits)
        self.afterstates = Afterstates(model, limits)
        self.maker = RowMaker(model, self.afterstates)
        self.index = StateIndex(model.packing.words)
        self.after_index = StateIndex(self.afterstates.packing.words)
        self.depth, self.visits = Growing(np.int32), Growing(np.int64)
        self.first_row, self.row_count = Growing(np.int64), Growing(np.int64)
        self.action, self.reward = Growing(np.int32), Growing(float)
        self.afterstate, self.tried = Growing(np.int32), Growing(np.int32)
        self.idle = Growing(float)
        self.origin, self.next = Growing(np.int32), Growing(np.int32)
        self.probability = Growing(float)
        self._is_complete = Growing(bool)
        self._drawn = StateIndex(1 + model.packing.words)
        self.add(model.initial[np.newaxis], np.zeros(1, np.int32))

    @property
    def size(self) -> int:
        """Number of states."""
        return self.index.count

    def owners(self) -> np.ndarray:
        """The state of each row [R]."""
        return np.repeat(np.arange(self.size), self.row_count.values)

    def was_drawn(self) -> np.ndarray:
        """Whether a next state of each afterstate [E] is known."""
        return np.bincount(self.origin.values, minlength=self.after_index.count) > 0

    def shorten_depths(self, check_time: Callable[[], None] = lambda: None) -> None:
        """Makes depths the least by all that was seen.

        What follows a state was drawn when it was first reached, perhaps by a detour.

        Args:
          check_time: called between two passes; what it raises leaves depths as they were.
        """
        owners, afterstate = self.owners(), self.afterstate.values
        origin, following = self.origin.values, self.next.values
        depth = self.depth.values.astype(np.int64)
        while True:
            after = np.full(self.after_index.count, int(NEVER), np.int64)
            np.minimum.at(after, afterstate, depth[owners])
            shorter = depth.copy()
            np.minimum.at(shorter, following, after[origin] + 1)
            if np.array_equal(shorter, depth):
                break
            depth = shorter
            check_time()
        self.depth.values[:] = depth

    def add(self, states: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """The numbers [N] of packed states [N, words], of which new ones get their rows.

        Args:
          states: reached.
          depth: after how many steps each was reached [N].

        Raises:
          NotEnumerableError: if a state has no legal action.
        """
        known = self.index.count
        numbers = self.index.numbers(merged(states, self.merges))
        if self.index.count > known:
            self._expand(self.index.states[known:])
        np.minimum.at(self.depth.values, numbers, depth.astype(np.int32))
        return numbers

    def draw(self, rows: np.ndarray, depth: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """The numbers [N] of the states that follow rows [N], played at a depth [N]."""
        origin = self.afterstate.values[rows]
        states, probability = self.afterstates.sample(self.after_index.states[origin], random)
        np.add.at(self.tried.values, rows, 1)
        drawn = Draws(origin, states, probability)
        # together, for it takes about as long to add a few states as to add many
        draws = [(drawn, depth), *self._complete(origin, depth)]
        reached = np.concatenate([each.states for each, _ in draws])
        numbers = self.add(reached, np.concatenate([at for _, at in draws]) + 1)
        ends = np.cumsum([len(at) for _, at in draws])
        for (each, _), own in zip(draws, np.split(numbers, ends[:-1]), strict=True):
            self._remember(each, own)
        return numbers[: len(rows)]

    def _complete(
        self, origin: np.ndarray, depth: np.ndarray
    ) -> Iterator[tuple[Draws, np.ndarray]]:
        """All that may follow afterstates [N], and depths [N], if it is little; with its depths."""
        new = self.after_index.count - self._is_complete.count
        self._is_complete.add(np.zeros(new, bool))
        first, where = np.unique(origin, return_index=True)
        open_ones = ~self._is_complete.values[first]
        first, where = first[open_ones], where[open_ones]
        self._is_complete.values[first] = True
        few = self.afterstates.outcomes(self.after_index.states[first]) <= _FEW
        first, where = first[few], where[few]
        if not len(first):
            return
        for draws in self.afterstates.draw(self.after_index.states[first]):
            yield draws._replace(origin=first[draws.origin]), depth[where][draws.origin]

    def _expand(self, states: np.ndarray) -> None:
        together = max(1, _ROWS_TOGETHER // len(self.model.actions))
        for start in range(0, len(states), together):
            self._append(*self._rows(states[start : start + together]))

    def _rows(self, states: np.ndarray) -> tuple[np.ndarray, Rows]:
        """How many rows each of states [N, words] has [N], and the rows."""
        counts = np.zeros(len(states), np.int64)
        alive = np.flatnonzero(~self.maker.ended(states))
        if not len(alive):
            return counts, NO_ROWS
        rows = with_rows(self.maker.rows(states[alive]), len(alive))
        counts[alive] = np.bincount(rows.state, minlength=len(alive))
        return counts, rows

    def _append(self, counts: np.ndarray, rows: Rows) -> None:
        """Takes states in, by what `_rows` says of them."""
        start, starts = self.reward.count, np.cumsum(counts) - counts
        if len(rows.reward):
            known = self.after_index.count
            numbers = self.after_index.numbers(rows.afterstates)
            idle = rows.reward[np.repeat(starts, counts)]
            first = np.full(self.after_index.count - known, np.inf)
            is_new = numbers >= known
            np.minimum.at(first, numbers[is_new] - known, idle[is_new])
            self.idle.add(first)
            self.action.add(rows.action)
            self.reward.add(rows.reward)
            self.afterstate.add(numbers)
            self.tried.add(np.zeros(len(numbers), np.int32))
        self.first_row.add(start + starts)
        self.row_count.add(counts)
        self.depth.add(np.full(len(counts), NEVER, np.int32))
        self.visits.add(np.zeros(len(counts), np.int64))

    def _remember(self, drawn: Draws, numbers: np.ndarray) -> None:
        """Keeps what was not drawn before; several states may have been joined to one number."""
        known = self._drawn.count
        pairs = np.column_stack([drawn.origin.astype(np.uint64), drawn.states])
        pair, where = np.unique(self._drawn.numbers(pairs), return_index=True)
        new = where[pair >= known]
        self.origin.add(drawn.origin[new])
        self.next.add(numbers[new])
        self.probability.add(drawn.probability[new])
