"""Trials: episodes side by side from the initial state, and backward induction now and then.

After real-time dynamic programming (Barto, Bradtke and Singh 1995) and trial-based heuristic tree
search (Keller and Helmert 2013), with the known probabilities of what trials have drawn. In place
of single backups all that was seen is gone through once it has grown by a share. Where the greedy
policy knows no state, a trial plays the actions that this policy uses elsewhere, or any. Every
other policy that trials follow hopes for luck and guesses what was not tried (`guide.py`). Other
trials begin at a state that has a rare value of some variable, and prefer what was rarely tried.
"""

import contextlib
from collections.abc import Callable

import numpy as np

from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.auto.search.trials.backward import Greedy, induct
from mdpo_rddl.auto.search.trials.explored import Explored
from mdpo_rddl.auto.search.trials.guide import guide
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, OutOfTimeError
from mdpo_rddl.problem.enumeration.model import GroundModel

_TRIALS = 512
# rows that one step of all trials may make, if all actions are legal: what lies between two
# looks at the clock
_ROWS_TOGETHER = 2_000_000
# states that one step of one trial may add
_STATES_OF_ONE = 8
# of the decisions of a trial, at random; and of these, by any action rather than a popular one
_DEVIATIONS = (0.0, 0.0, 0.0, 0.05, 0.2)
_ANY_ACTION = (0.05, 0.2, 0.5, 1.0)
# from one backward induction to the next; without one it is a guide that is followed
_TRUSTS = (0.5, None, 1.0, None, 0.9, None, 1.0, None)
_GROWTH, _INDUCTION_SHARE = 1.25, 0.25
# of an induction, for each row and step, as long as none was timed
_ROW_SECONDS = 2e-8
# of a trial that begins anywhere
_STEPS, _CHOICES, _OUTCOMES = 8, 3, 2
_MOST_STATES, _MOST_ROWS, _MOST_DECISIONS = 400_000, 4_000_000, 20_000_000


class TrialSearch:
    """Explores a ground model.

    Attributes:
      explored: what was seen.
      is_full: whether there is no room for more.
      batches: of trials, so far.
      has_ended: whether one of them has come to the end of its trials.
    """

    def __init__(
        self, model: GroundModel, limits: EnumerationLimits, seed: int, clock: Clock
    ) -> None:
        """Knows the initial state.

        Args:
          model: of the problem.
          limits: for the preparation.
          seed: of all draws.
          clock: what is asked for the time.

        Raises:
          NotEnumerableError: if the model is not understood, or there is too little time.
        """
        self.explored = Explored(model, limits)
        together = _ROWS_TOGETHER // (_STATES_OF_ONE * len(model.actions))
        # 50 for as many actions as a ground model may have
        self._trials = min(_TRIALS, together)
        self.batches = 0
        self.is_full = self.has_ended = False
        self._random = np.random.default_rng(seed)
        self._clock = clock
        self._greedy = induct(self.explored, 1.0)
        self._rarity = np.ones(1)
        self._inductions = 0
        self._searching = self._inducting = 0.0
        # of the latest induction without a guide
        self._row_seconds = _ROW_SECONDS * model.horizon

    def work(
        self,
        until: float,
        pulse: Callable[[], None] = lambda: None,
        to_be_left: Callable[[float], float] = lambda induction: 0.0,
    ) -> None:
        """Plays trials; the steps of one are not begun after the end.

        Args:
          until: when to end, by the clock.
          pulse: called between two batches.
          to_be_left: seconds before that, by those that a backward induction is likely to take.

        Raises:
          NotEnumerableError: if a state has no legal action, or a probability is none.
        """

        def ends() -> float:
            return until - to_be_left(self._induction_seconds)

        while not self.is_full and self._clock() < ends():
            pulse()
            started = self._clock()
            self.has_ended |= self._from_the_start(ends)
            self._from_rare_states(ends)
            self._searching += self._clock() - started
            self.batches += 1
            if self._clock() < (by := ends()):
                self._induct_if_grown(by)

    def found(self, trust: float, check_time: Callable[[], None] = lambda: None) -> Greedy:
        """The best policy on what was seen.

        Args:
          trust: in what was not, see `induct`.
          check_time: see `induct`.
        """
        return induct(self.explored, trust, check_time)

    def _induct_if_grown(self, until: float) -> None:
        grown = self.explored.size > _GROWTH * self._greedy.rows.shape[1]
        if self._inducting > _INDUCTION_SHARE * self._searching or not (
            grown or self.batches % len(_DEVIATIONS) == 0
        ):
            return
        started = self._clock()
        trust = _TRUSTS[self._inductions % len(_TRUSTS)]
        limits = EnumerationLimits(until - started, clock=self._clock)
        with contextlib.suppress(OutOfTimeError):  # the policy before is followed on
            self._greedy = (
                guide(self.explored, limits.check_time)
                if trust is None
                else induct(self.explored, trust, limits.check_time)
            )
            self._rarity = _rarity(self.explored, self.explored.size)
            self._inductions += 1
            if trust is not None:  # time is left for such ones
                seconds = self._clock() - started
                self._row_seconds = seconds / max(1, self.explored.reward.count)
        self._inducting += self._clock() - started

    @property
    def _induction_seconds(self) -> float:
        """That an induction over what was seen is likely to take."""
        return self._row_seconds * self.explored.reward.count

    @property
    def _most_states(self) -> int:
        return min(_MOST_STATES, _MOST_DECISIONS // self.explored.model.horizon)

    def _is_over(self, ends: Callable[[], float]) -> bool:
        explored = self.explored
        self.is_full = explored.size > self._most_states or explored.reward.count > _MOST_ROWS
        return self.is_full or self._clock() >= ends()

    def _from_the_start(self, ends: Callable[[], float]) -> bool:
        """Trials that mostly follow the greedy policy; whether they have come to their end."""
        explored, random, known = self.explored, self._random, self._greedy.rows.shape[1]
        states = np.zeros(self._trials, np.int64)
        deviation = random.choice(_DEVIATIONS, self._trials)
        mixture = random.choice(_ANY_ACTION, self._trials)
        for step in range(explored.model.horizon):
            alive = explored.row_count.values[states] > 0
            states, deviation, mixture = states[alive], deviation[alive], mixture[alive]
            if not len(states):
                return True
            if self._is_over(ends):
                return False
            np.add.at(explored.visits.values, states, 1)
            rows = self._rows_at_random(states, mixture)
            follows = (states < known) & (random.random(len(states)) >= deviation)
            rows[follows] = self._greedy.rows[step, states[follows]]
            states = explored.draw(rows, np.full(len(rows), step), random)
        return True

    def _rows_at_random(self, states: np.ndarray, mixture: np.ndarray) -> np.ndarray:
        """A row for each state [N]: of a popular action, or with a probability [N] of any."""
        explored = self.explored
        counts = explored.row_count.values[states]
        ends = np.cumsum(counts)
        starts = ends - counts
        own = np.repeat(np.arange(len(states)), counts)
        rows = (explored.first_row.values[states] - starts)[own] + np.arange(ends[-1])
        weights = self._greedy.popularity[explored.action.values[rows]]
        total = np.bincount(own, weights, len(states))
        share = np.where(total > 0.0, 1.0 - mixture, 0.0)
        weights = weights * (share / np.where(total > 0.0, total, 1.0))[own]
        weights += ((1.0 - share) / counts)[own]
        reached = np.cumsum(weights)
        before = np.concatenate([np.zeros(1), reached])[starts]
        drawn = before + self._random.random(len(states)) * (reached[ends - 1] - before)
        chosen = np.searchsorted(reached, drawn, side="right")
        return rows[np.clip(chosen, starts, ends - 1)]

    def _from_rare_states(self, ends: Callable[[], float]) -> None:
        """Short trials from anywhere, for what was rarely seen."""
        explored, random = self.explored, self._random
        horizon = explored.model.horizon
        known = len(self._rarity)
        weights = self._rarity / np.sqrt(1.0 + explored.visits.values[:known])
        weights *= explored.row_count.values[:known] > 0
        weights *= explored.depth.values[:known] < horizon - 1
        if not weights.any():
            return
        states = random.choice(known, self._trials, p=weights / weights.sum())
        depth = explored.depth.values[states].astype(np.int64)
        for _ in range(_STEPS):
            alive = (explored.row_count.values[states] > 0) & (depth < horizon)
            states, depth = states[alive], depth[alive]
            if not len(states) or self._is_over(ends):
                return
            np.add.at(explored.visits.values, states, 1)
            counts = explored.row_count.values[states]
            offsets = (random.random((_CHOICES, len(states))) * counts).astype(np.int64)
            rows = _least(explored.first_row.values[states] + offsets, explored.tried.values)
            outcomes = [explored.draw(rows, depth, random) for _ in range(_OUTCOMES)]
            states, depth = _least(np.array(outcomes), explored.visits.values), depth + 1


def _least(choices: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Of each column of choices [C, N] the one of the smallest count, the first of equals [N]."""
    return np.asarray(choices[np.argmin(counts[choices], axis=0), np.arange(choices.shape[1])])


def _rarity(explored: Explored, known: int) -> np.ndarray:
    """How few others have a state's value of a variable, for the one that is rarest.

    Args:
      explored: what was seen.
      known: number of states, K, that are looked at.

    Returns:
      Of each of them [K].
    """
    states, packing = explored.index.states[:known], explored.model.packing
    rarest = np.ones(len(states))
    for number in range(len(explored.model.variables)):
        values = packing.decode(number, states).astype(np.int64)
        values -= values.min()
        np.maximum(rarest, len(states) / np.bincount(values)[values], out=rarest)
    return rarest
