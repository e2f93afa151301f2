"""What trials have seen of a ground model: states, what may be done there, and what followed."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from mdpo_rddl.auto.common.state import State, joined
from mdpo_rddl.auto.search.trials.compact import level_state, read_levels, read_numbers, small
from mdpo_rddl.auto.search.trials.growing import Growing
from mdpo_rddl.problem.enumeration.afterstates import Afterstates, Draws
from mdpo_rddl.problem.enumeration.index import StateIndex
from mdpo_rddl.problem.enumeration.irrelevance import find_merges, merged
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits
from mdpo_rddl.problem.enumeration.model import GroundModel
from mdpo_rddl.problem.enumeration.rows import NO_ROWS, RowMaker, Rows

NEVER = np.iinfo(np.int32).max
"""The depth of a state that was not reached from the initial one yet."""
# next states after an afterstate that are all added with the first that is drawn
_FEW = 4
# rows that are made together where the states are known before, if all actions are legal
_ROWS_TOGETHER = 500_000
# of the probabilities of all next states that are known
_ROUNDING = 1e-6


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
        # numbers of the states whose rows were made together
        self._batches = Growing(np.int64)
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
        rows = self.maker.rows(states[alive])
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
        # last: these states are whole, whatever interrupts
        self._batches.add(np.array([len(counts)]))

    def _remember(self, drawn: Draws, numbers: np.ndarray) -> None:
        """Keeps what was not drawn before; several states may have been joined to one number."""
        known = self._drawn.count
        pairs = np.column_stack([drawn.origin.astype(np.uint64), drawn.states])
        pair, where = np.unique(self._drawn.numbers(pairs), return_index=True)
        new = where[pair >= known]
        self.origin.add(drawn.origin[new])
        self.next.add(numbers[new])
        self.probability.add(drawn.probability[new])

    def state(self) -> State:
        """What was seen, without what follows from it and the model.

        What an interruption has left half done is left out.
        """
        batches = self._batches.values
        size = int(batches.sum())
        rows = int(self.row_count.values[:size].sum())
        after = int(self.afterstate.values[:rows].max(initial=-1)) + 1
        drawn = min(self.origin.count, self.next.count, self.probability.count)
        own = {
            "states": self.index.states[:size].copy(),
            "batches": small(batches),
            "depth": small(np.minimum(self.depth.values[:size], self.model.horizon)),
            "visits": small(self.visits.values[:size]),
            "tried": small(self.tried.values[:rows]),
            "complete": small(self._is_complete.values[:after].astype(np.int64)),
            "drawn": self._drawn.states[:drawn].copy(),
            "probability": self.probability.values[:drawn].copy(),
        }
        return joined(State(own), level_state(self.afterstates.levels()).within("levels"))

    def restoring(self, state: State, most_together: int) -> Iterator[None]:
        """Makes the rows of what another one has seen, while nothing was drawn here.

        Args:
          state: of the other one, which had the same model.
          most_together: states that may have been added at once.

        Yields:
          Between two parts of the work.

        Raises:
          NotEnumerableError: if it has no such rows.
          KeyError, OverflowError, TypeError, ValueError: if it does not fit.
        """
        states = state.array("states", (None, self.model.packing.words))
        batches = read_numbers(state, "batches", None, most_together)
        if len(states) != batches.sum() or not np.array_equal(states[:1], self.index.states):
            raise ValueError("its states are not those of its batches")
        self._check(states)
        if np.any(merged(states, self.merges) != states):
            raise ValueError("its states have what does not matter")
        self.afterstates.know(read_levels(state.part("levels")))
        self.index = StateIndex.of(states)
        most = _ROWS_TOGETHER // len(self.model.actions)
        for some in _together(batches.tolist()[1:], most):
            counts, rows = self._rows(states[self.depth.count :][: sum(some)])
            for own in np.split(counts, np.cumsum(some)[:-1]):
                self._append(own, Rows(*(each[: own.sum()] for each in rows)))
                rows = Rows(*(each[own.sum() :] for each in rows))
            yield
        self._restore_counts(state)
        self._restore_draws(state)

    def _check(self, states: np.ndarray) -> None:
        """Raises ValueError if packed states [N, words] have bits that are no variable's."""
        if states.dtype != np.uint64:
            raise ValueError(f"its states are {states.dtype}")
        used = np.zeros(states.shape[1], np.uint64)
        for place in self.model.packing.places:
            used[place.word] |= place.mask
        if np.any(states & ~used):
            raise ValueError("its states have values of no variable")

    def _restore_counts(self, state: State) -> None:
        size, many = self.size, np.iinfo(np.int32).max
        self.depth.values[:] = read_numbers(state, "depth", size, self.model.horizon)
        self.visits.values[:] = read_numbers(state, "visits", size, many)
        self.tried.values[:] = read_numbers(state, "tried", self.tried.count, many)
        complete = read_numbers(state, "complete", None, 1)
        if len(complete) > self.after_index.count:
            raise ValueError("its afterstates are too many")
        self._is_complete.add(complete.astype(bool))

    def _restore_draws(self, state: State) -> None:
        drawn = state.array("drawn", (None, 1 + self.model.packing.words))
        probability = state.array("probability", (len(drawn),)).astype(float)
        origin, states = drawn[:, 0], drawn[:, 1:]
        self._check(states)
        if np.any(origin >= self.after_index.count):
            raise ValueError("its draws are after nothing")
        numbers = self.index.known(merged(states, self.merges))
        total = np.bincount(origin.astype(np.int64), probability)
        if np.any(numbers < 0) or np.any(probability < 0.0) or np.any(total > 1.0 + _ROUNDING):
            raise ValueError("its draws lead nowhere, or their probabilities are none")
        self._drawn = StateIndex.of(drawn)
        self.origin.add(origin)
        self.next.add(numbers)
        self.probability.add(probability)


def _together(batches: Sequence[int], most: int) -> Iterator[Sequence[int]]:
    """Batches of about so many states at most: many small calls take longer than large ones."""
    some: list[int] = []
    total = 0
    for count in batches:
        some.append(count)
        total += count
        if total >= most:
            yield some
            some, total = [], 0
    if some:
        yield some
