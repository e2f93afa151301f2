"""What an episode is expected to return more than with the prepared policy alone."""

from dataclasses import dataclass, field

import numpy as np

from mdpo_rddl.policy.lookahead.base import Gain
from mdpo_rddl.policy.lookahead.gains import NOT_FINITE

# a mean with a return in it that is not finite is far below
_LEAST = NOT_FINITE / 1e6


@dataclass
class Expectation:
    """What each decision adds to it.

    Where returns differ from scenario to scenario a decision counts by itself, for what its
    candidate gains a step. Else the candidate is a plan that is followed, and its gain is counted
    once: later decisions count for what they add to it.

    Attributes:
      is_random: whether returns differ from scenario to scenario.
      discount: of a step; gains are returns from a decision on, but those of an episode are asked
        for.
    """

    is_random: bool
    discount: float
    _is_counted: bool = field(default=False, init=False)
    _counted: float = field(default=0.0, init=False)

    def begin(self) -> None:
        """An episode begins, of which nothing is counted yet."""
        self._is_counted, self._counted = False, 0.0

    def decided(
        self, step: int, chosen: Gain | None, followed: Gain | None, left_base: bool
    ) -> tuple[float, float]:
        """What a decision adds, and its standard error.

        Args:
          step: its number in its episode.
          chosen: what is played, of a mean of 0 if it was not tested; None for the base.
          followed: what the plan gains in the same test that was followed so far, if there is one.
          left_base: whether the action that is played is not the base's.
        """
        weight = self.discount**step
        if self.is_random:
            if chosen is None or not left_base:
                return 0.0, 0.0
            return weight * chosen.rate, weight * chosen.error / chosen.steps
        is_known = self._is_counted and followed is not None and followed.mean > _LEAST
        self._counted = followed.mean if is_known and followed is not None else 0.0
        if chosen is None:
            return weight * (0.0 - self._counted), 0.0
        if chosen.mean == 0.0:
            return 0.0, 0.0
        goes_on = followed is not None and np.array_equal(chosen.candidate, followed.candidate)
        error = 0.0 if self._is_counted and goes_on else chosen.error
        self._is_counted = True
        return weight * (chosen.mean - self._counted), weight * error

    def replaced(self, step: int) -> float:
        """What the latest decision adds if another action was played in the end.

        What was counted of the plan is taken back; what is left of it is counted at the next
        decision.
        """
        lost, self._is_counted = self._counted, False
        return self.discount**step * (0.0 - lost)
