"""What thinking is expected to gain in an episode."""

from dataclasses import dataclass, field

import numpy as np

from mdpo_rddl.policy.lookahead.base import Gain
from mdpo_rddl.policy.lookahead.gains import NOT_FINITE

# a mean with a return in it that is not finite is far below
_LEAST = NOT_FINITE / 1e6


@dataclass
class Expectation:
    """How much more than the prepared policy alone an episode is expected to return.

    Where returns differ from scenario to scenario a decision counts by itself, for what its
    candidate gains a step. Else the candidate is a plan that is followed, and its gain is counted
    once: later decisions count for what they add to it. A plan that an episode begins with, without
    time for a test, counts for what the last episode was expected to gain by it.

    Attributes:
      is_random: whether returns differ from scenario to scenario.
      discount: of a step. A decision's rollouts are discounted from it on, and count in the return
        of the episode with the discount of the steps before.
    """

    is_random: bool
    discount: float
    # whether the plan that is followed is counted, and what the latest test has found of it
    _is_counted: bool = field(default=False, init=False)
    _counted: float = field(default=0.0, init=False)
    _is_tested: bool = field(default=False, init=False)
    # of this episode, of its latest decision, and of the last episode until a plan is tested
    _total: float = field(default=0.0, init=False)
    _latest: float = field(default=0.0, init=False)
    _before: float = field(default=0.0, init=False)

    def begin(self) -> None:
        """The last episode begins again."""
        before = self._total
        self.forget()
        self._before = before

    def forget(self) -> None:
        """An episode begins of which nothing is known."""
        self._is_counted, self._counted, self._is_tested = False, 0.0, False
        self._total = self._latest = self._before = 0.0

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
        added, error = self._added(chosen, followed)
        self._latest = weight * added
        self._total += self._latest
        return self._latest, weight * error

    def _added(self, chosen: Gain | None, followed: Gain | None) -> tuple[float, float]:
        """The same of what is not random, from the decision on."""
        self._is_tested = chosen is None or chosen.mean != 0.0
        if not self._is_tested:
            added = 0.0 if self._is_counted else self._before
            self._is_counted = True
            return added, 0.0
        self._counted = self._before = 0.0
        if self._is_counted and followed is not None and followed.mean > _LEAST:
            self._counted = followed.mean
        if chosen is None:
            return 0.0 - self._counted, 0.0
        goes_on = followed is not None and np.array_equal(chosen.candidate, followed.candidate)
        error = 0.0 if self._is_counted and goes_on else chosen.error
        self._is_counted = True
        return chosen.mean - self._counted, error

    def replaced(self, step: int) -> float:
        """What the latest decision adds if another action was played in the end.

        What was counted of the plan is taken back, as far as the decision has tested it; what is
        left of it is counted at the next decision.
        """
        if self._is_tested:
            self._is_counted = False
            self._total -= self._latest
            self._latest = self.discount**step * (0.0 - self._counted)
            self._total += self._latest
        return self._latest
