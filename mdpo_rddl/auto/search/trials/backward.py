"""Backward induction over what trials have seen.

With horizon H, V_H = 0 and discount g:

    Q_t(s, a) = r(s, a) + g (sum_k P(k) V_{t+1}(k) + (1 - sum_k P(k)) U),   V_t(s) = max_a Q_t(s, a)

The sums are over the next states k that were seen. What was not seen is worth U: a mixture of the
mean of what was seen, and of the default action's reward there in every step that is left,
discounted.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from mdpo_rddl.auto.search.trials.explored import Explored

Guess = Callable[[int], np.ndarray]
"""Of a step, what an action of which nothing was seen is worth there in each state [S]."""

_TIE = 1e-9
# rows that are gone through from one look at the clock to the next: some hundredths of a second
_ROWS_UNTIMED = 1_000_000


class Greedy(NamedTuple):
    """The best policy on what was seen.

    Attributes:
      rows: what to play in each state at each step [H, S], a row; -1 where the episode has ended.
      value: of the initial state.
      popularity: of each action of the model [A]: how often, over the states that trials have
        visited, it is what to play and worth more than the no-op for ever.
    """

    rows: np.ndarray
    value: float
    popularity: np.ndarray


def induct(
    explored: Explored, trust: float, check_time: Callable[[], None] = lambda: None
) -> Greedy:
    """The best policy.

    Args:
      explored: with S states.
      trust: that what was not seen is like what was, rather than like the no-op: 0 gives a
        value that is not too large where no reward is below the default action's, 1 leads
        trials to what is new.
      check_time: called now and then; what it raises ends the induction.
    """
    return greedy_of(explored, *swept(explored, Future(explored, trust), check_time))


def swept(
    explored: Explored,
    future: "Future",
    check_time: Callable[[], None] = lambda: None,
    guess: Guess | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Goes through all steps, the last one first.

    Args:
      explored: with S states.
      future: says what is to be expected after an action.
      check_time: as of `induct`.
      guess: what `future` says if None. It is not asked at the last step, where all is known.

    Returns:
      What to play in each state at each step [H, S], as `Greedy` has it, and what each state is
      worth at the least step at which it is reached [S].
    """
    horizon, discount = explored.model.horizon, explored.model.discount
    decided = np.flatnonzero(explored.row_count.values)
    rows = np.full((horizon, explored.size), -1, np.int32)
    values, at_depth = np.zeros((2, explored.size))
    if not len(decided):
        return rows, at_depth
    starts = explored.first_row.values[decided]
    counts = explored.row_count.values[decided]
    reward, afterstate = explored.reward.values, explored.afterstate.values
    explored.shorten_depths(check_time)
    everything = np.arange(len(reward))
    unseen = np.flatnonzero(~explored.was_drawn()[afterstate])
    their_states = explored.owners()[unseen]
    timed_steps = 1 + _ROWS_UNTIMED // len(reward)
    for step in reversed(range(horizon)):
        if (horizon - step) % timed_steps == 0:
            check_time()
        q = reward + discount * future.values(values, horizon - 1 - step)[afterstate]
        if guess is not None and step < horizon - 1:
            q[unseen] = guess(step)[their_states]
        best = np.maximum.reduceat(q, starts)
        # rounding shall not choose
        enough = np.repeat(best - _TIE * (1 + np.abs(best)), counts)
        rows[step, decided] = np.minimum.reduceat(np.where(q >= enough, everything, len(q)), starts)
        values[decided] = best
        here = explored.depth.values == step
        at_depth[here] = values[here]
    return rows, at_depth


def greedy_of(explored: Explored, rows: np.ndarray, at_depth: np.ndarray) -> Greedy:
    """A policy with what is known of it, as `swept` gives it; the first state is initial."""
    popularity = np.zeros(len(explored.model.actions)) + _popularity(explored, rows, at_depth)
    return Greedy(rows, float(at_depth[0]), popularity)


def annuity(discount: float, steps: Any) -> Any:
    """What a reward of 1 in each of so many steps is worth before the first of them."""
    if discount == 1.0:
        return steps
    return (1.0 - discount**steps) / (1.0 - discount)


class Future:
    """What is to be expected of next states."""

    def __init__(self, explored: Explored, trust: float, hope: float = 0.0) -> None:
        """Adds up the probabilities that are known.

        Args:
          explored: what was seen.
          trust: see `induct`.
          hope: share of the best that was seen, rather than of the mean.
        """
        self._origin, self._next = explored.origin.values, explored.next.values
        self._probability = explored.probability.values
        self._idle = explored.idle.values
        self._count, self._hope = explored.after_index.count, hope
        self._discount = explored.model.discount
        seen = np.bincount(self._origin, self._probability, self._count)
        self._unseen = np.maximum(0.0, 1.0 - seen)
        self._scale = 1.0 + trust * self._unseen / np.where(seen > 0.0, seen, 1.0)
        self._doubt = np.where(seen > 0.0, (1.0 - trust) * self._unseen, 1.0)

    def values(self, values: np.ndarray, left: int) -> np.ndarray:
        """After each afterstate [E], with next states' values [S] and so many steps left."""
        weighted = self._probability * values[self._next]
        seen = np.bincount(self._origin, weighted, self._count)
        idle = annuity(self._discount, left) * self._idle
        expected = seen * self._scale + self._doubt * idle
        return expected if self._hope == 0.0 else self._hopeful(expected, values)

    def _hopeful(self, expected: np.ndarray, values: np.ndarray) -> np.ndarray:
        best = np.full(self._count, -np.inf)
        np.maximum.at(best, self._origin, values[self._next])
        mixed = (1.0 - self._hope) * expected + self._hope * best
        return np.where(np.isfinite(best), mixed, expected)


def _popularity(explored: Explored, rows: np.ndarray, values: np.ndarray) -> np.ndarray:
    """See `Greedy`; `values` are those of the states [S] at the steps at which they are reached."""
    horizon = len(rows)
    depth, visits = explored.depth.values, explored.visits.values
    used = np.flatnonzero((visits > 0) & (depth < horizon) & (explored.row_count.values > 0))
    played = rows[depth[used], used]
    idle = explored.idle.values[explored.afterstate.values[explored.first_row.values[used]]]
    nothing = idle * annuity(explored.model.discount, horizon - depth[used])
    is_better = values[used] > nothing + _TIE * (1 + np.abs(nothing))
    chosen = explored.action.values[played[is_better]]
    weights = np.sqrt(visits[used][is_better])
    return np.bincount(chosen, weights, len(explored.model.actions))
