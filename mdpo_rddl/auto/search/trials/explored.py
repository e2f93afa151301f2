"""What trials have seen of a ground model: states, what may be done there, and what followed."""

import numpy as np

from mdpo_rddl.auto.search.trials.growing import Growing
from mdpo_rddl.problem.enumeration.index import StateIndex
from mdpo_rddl.problem.enumeration.irrelevance import find_merges, merged
from mdpo_rddl.problem.enumeration.levels import Afterstates, Draws
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits
from mdpo_rddl.problem.enumeration.model import GroundModel
from mdpo_rddl.problem.enumeration.rows import RowMaker

NEVER = np.iinfo(np.int32).max
"""The depth of a state that was not reached from the initial one yet."""
# next states after an afterstate that are all added with the first that is drawn
_FEW = 4


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
        numbers = self.add(states, depth + 1)
        self._remember(Draws(origin, states, probability), numbers)
        self._complete(origin, depth)
        return numbers

    def _complete(self, origin: np.ndarray, depth: np.ndarray) -> None:
        """Adds all that may follow afterstates [N], drawn at a depth [N], if it is little."""
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
            numbers = self.add(draws.states, depth[where][draws.origin] + 1)
            self._remember(draws._replace(origin=first[draws.origin]), numbers)

    def _expand(self, states: np.ndarray) -> None:
        counts = np.zeros(len(states), np.int64)
        alive = np.flatnonzero(~self.maker.ended(states))
        start = self.reward.count
        if len(alive):
            rows = self.maker.rows(states[alive])
            counts[alive] = np.bincount(rows.state, minlength=len(alive))
            known = self.after_index.count
            numbers = self.after_index.numbers(rows.afterstates)
            own = counts[alive]
            idle = rows.reward[np.cumsum(own) - own][rows.state]
            first = np.full(self.after_index.count - known, np.inf)
            is_new = numbers >= known
            np.minimum.at(first, numbers[is_new] - known, idle[is_new])
            self.idle.add(first)
            self.action.add(rows.action)
            self.reward.add(rows.reward)
            self.afterstate.add(numbers)
            self.tried.add(np.zeros(len(numbers), np.int32))
        self.first_row.add(start + np.cumsum(counts) - counts)
        self.row_count.add(counts)
        self.depth.add(np.full(len(states), NEVER, np.int32))
        self.visits.add(np.zeros(len(states), np.int64))

    def _remember(self, drawn: Draws, numbers: np.ndarray) -> None:
        """Keeps what was not drawn before; several states may have been joined to one number."""
        known = self._drawn.count
        pairs = np.column_stack([drawn.origin.astype(np.uint64), drawn.states])
        pair, where = np.unique(self._drawn.numbers(pairs), return_index=True)
        new = where[pair >= known]
        self.origin.add(drawn.origin[new])
        self.next.add(numbers[new])
        self.probability.add(drawn.probability[new])
