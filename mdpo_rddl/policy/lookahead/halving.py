"""Sequential halving of candidates by their paired gains, until a deadline."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mdpo_rddl.policy.lookahead.base import Gain
from mdpo_rddl.policy.lookahead.gains import Scores, steps_to_last_change
from mdpo_rddl.policy.lookahead.simulator import NARROW, WIDE, Simulator

# a candidate whose gain is below zero by so many errors is not played again
_HOPELESS = 3.0


@dataclass
class Halving:
    """Plays candidates of one decision on common scenarios.

    Attributes:
      simulator: plays them.
      state: as the environment shows it.
      step: its number.
      base: candidate 0 [k, D].
      clock: tells the seconds.
      next_seed: gives a seed of fresh scenarios.
    """

    simulator: Simulator
    state: Mapping[str, Any]
    step: int
    base: np.ndarray
    clock: Callable[[], float]
    next_seed: Callable[[], int]
    calls: int = field(default=0, init=False)

    def run(self, candidates: np.ndarray, until: float) -> list[Gain]:
        """Halves the candidates [n, k, D] until few are left or the time is over.

        Returns:
          The gains of those that were played, the largest first; those that were kept longest
          are before the others.
        """
        few = self.simulator.challengers(NARROW)
        scores, everyone = Scores.of(len(candidates)), np.arange(len(candidates))
        left = everyone
        ranking: list[int] = []
        while len(left):
            kind = NARROW if len(left) <= few else WIDE
            rounds = 1 + max(0, math.ceil(math.log2(len(left) / few)))
            now = self.clock()
            played = self._round(
                kind, candidates, left, scores, (now + (until - now) / rounds, until)
            )
            order = played[np.argsort(-scores.mean[played], kind="stable")]
            hopeful = order[self._is_hopeful(scores, order)]
            kept = hopeful[: max(few, (len(left) + 1) // 2)]
            is_certain = self._is_certain(scores, hopeful, self.simulator.is_random)
            if is_certain or kind == NARROW or not self._has_time(kind, until):
                ranking = [*order.tolist(), *ranking]
                break
            ranking = [*order[~np.isin(order, kept)].tolist(), *ranking]
            left = kept
        mean, error = scores.mean, scores.error
        return [self._gain(candidates[p], mean[p], error[p]) for p in ranking]

    def test(self, finalists: np.ndarray, until: float, most_calls: int) -> list[Gain]:
        """Plays at most `challengers(NARROW)` candidates on fresh scenarios.

        Args:
          finalists: [n, k, D].
          until: no call begins that would end later.
          most_calls: so many at most.
        """
        scores = Scores.of(len(finalists))
        everyone = np.arange(len(finalists))
        for _ in range(most_calls):
            if len(self._sweep(NARROW, finalists, everyone, scores, until)) < len(finalists):
                break
            if self._is_certain(scores, everyone, self.simulator.may_draw):
                break
            if not np.any(self._is_hopeful(scores, everyone)):
                break
        mean, error = scores.mean, scores.error
        return [self._gain(finalists[p], mean[p], error[p]) for p in everyone]

    def _gain(self, candidate: np.ndarray, mean: float, error: float) -> Gain:
        left = self.simulator.horizon - self.step
        steps = steps_to_last_change(candidate, self.base, left)
        return Gain(candidate, float(mean), float(error), steps)

    def _is_certain(self, scores: Scores, places: np.ndarray, is_random: bool) -> bool:
        """Whether more scenarios tell nothing new: equal gains do not say so where any differ."""
        return not is_random and not np.any(scores.error[places] > 0.0)

    def _is_hopeful(self, scores: Scores, places: np.ndarray) -> np.ndarray:
        return scores.mean[places] + _HOPELESS * scores.error[places] > 0.0

    def _round(
        self,
        kind: str,
        candidates: np.ndarray,
        left: np.ndarray,
        scores: Scores,
        ends: tuple[float, float],
    ) -> np.ndarray:
        """Sweeps until the round's time is over, and once as far as all the time reaches.

        Args:
          kind: of the calls.
          candidates: all of them [n, k, D].
          left: those that are played.
          scores: of all; the gains are added.
          ends: of the round, and of all rounds.

        Returns:
          Those that were reached.
        """
        until, latest = ends
        played = self._sweep(kind, candidates, left, scores, latest)
        sweeps = math.ceil(len(left) / self.simulator.challengers(kind))
        while len(played) == len(left) and np.any(self._is_hopeful(scores, played)):
            if self._is_certain(scores, played, self.simulator.is_random):
                break
            if self.clock() + sweeps * self.simulator.seconds(kind, self.step) > until:
                break
            self._sweep(kind, candidates, left, scores, until)
        return played

    def _has_time(self, kind: str, until: float) -> bool:
        return self.clock() + self.simulator.seconds(kind, self.step) <= until

    def _sweep(
        self, kind: str, candidates: np.ndarray, left: np.ndarray, scores: Scores, until: float
    ) -> np.ndarray:
        """Plays all that are left once, on the same scenarios; those that were reached."""
        seed, challengers = self.next_seed(), self.simulator.challengers(kind)
        for start in range(0, len(left), challengers):
            if not self._has_time(kind, until):
                return left[:start]
            places = left[start : start + challengers]
            played = np.concatenate([self.base[np.newaxis], candidates[places]])
            gains = self.simulator.gains(kind, self.state, self.step, played, seed)
            scores.add(places, gains)
            self.calls += 1
        return left
