"""Gradient steps on one plan, which go on from decision to decision; where nothing is random."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mdpo_rddl.planner.climbing import Ascent
from mdpo_rddl.policy.lookahead.additions import Additions, one_step_later
from mdpo_rddl.policy.lookahead.base import Gain, Situation

_DEPTH = 100
# Adam's, in units of the components; and their share of the search's time
_RATE, _SHARE = 0.001, 0.9
# decisions in a row at which the ascent's end was not played, after which it begins anew
_MOST_REFUSED = 5


@dataclass
class GradientSteps(Additions):
    """One plan of additions to the policy's actions, on which Adam goes on at each decision.

    Its moments are kept, and move on with the plan: it is as if the preparation went on while the
    episode is played. Where chance plays a part the next state is not the one that the plan was
    made for.

    Attributes:
      depth: number of steps k.
    """

    name: str = "gradient steps"
    depth: int = _DEPTH
    rounds: int = 1
    climbs: bool = True
    is_for_chance: bool = False
    _ascent: Ascent | None = field(default=None, init=False)
    _refused: int = field(default=0, init=False)

    def reset(self) -> None:
        """The plan of a new episode adds nothing."""
        super().reset()
        self._ascent, self._refused = None, 0

    def begin(self, situation: Situation) -> None:
        """Goes on climbing, or begins with the plan that is followed."""
        self._base = situation.base
        known = self._ascent or Ascent.from_candidates(self._plan[np.newaxis])
        start = known._replace(candidates=self._candidates(known.candidates))
        climbed = situation.climb(start, np.array([_RATE]), _SHARE)
        if climbed is not None:
            reached = self._additions(climbed.ascent.candidates)
            self._ascent = climbed.ascent._replace(candidates=reached)

    def propose(self, gains: Sequence[Gain], random: np.random.Generator) -> np.ndarray:
        """The plan that is followed, and where the ascent has led [P, k, D]."""
        del gains, random
        ends = [] if self._ascent is None else [*self._ascent.candidates]
        return self._candidates(np.stack([self._plan, *ends]))

    def shift(self, chosen: np.ndarray) -> None:
        """The rest of the plan that was played, and of the ascent."""
        super().shift(chosen)
        if self._ascent is None:
            return
        is_end = np.array_equal(self._candidates(self._ascent.candidates)[0], chosen[: self.depth])
        self._refused = 0 if is_end else self._refused + 1
        ascent, goes_on = self._ascent, self._refused < _MOST_REFUSED
        self._ascent = None
        if goes_on:
            moved = ascent.changed(lambda part: one_step_later(part, np.zeros_like(chosen)))
            self._ascent = moved._replace(candidates=one_step_later(ascent.candidates, chosen))
        self._refused %= _MOST_REFUSED
