"""Gradient steps on one plan, which go on from decision to decision; where nothing is random."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mdpo_rddl.planner.climbing import Ascent
from mdpo_rddl.policy.lookahead.additions import candidates_of, one_step_later
from mdpo_rddl.policy.lookahead.base import Gain, Situation
from mdpo_rddl.policy.lookahead.components import Components

_DEPTH = 100
# Adam's, in units of the components; and their share of the search's time
_RATE, _SHARE = 0.001, 0.9
# decisions in a row at which the ascent's end was not played, after which it begins anew
_MOST_REFUSED = 5


@dataclass
class GradientSteps:
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
    _components: Components | None = field(default=None, init=False)
    _base: np.ndarray = field(default_factory=lambda: np.zeros(0), init=False)
    _plan: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)), init=False)
    _ascent: Ascent | None = field(default=None, init=False)
    _refused: int = field(default=0, init=False)

    def applies(self, components: Components) -> bool:
        """Some component is real."""
        self._components = components
        self.reset()
        return bool(np.any(components.is_real))

    def reset(self) -> None:
        """The plan of a new episode adds nothing."""
        assert self._components is not None  # `applies` was asked first
        self._plan = np.zeros((self.depth, self._components.size), np.float32)
        self._ascent, self._refused = None, 0

    def begin(self, situation: Situation) -> None:
        """Goes on climbing, or begins with the plan that is followed."""
        self._base = situation.base
        known = self._ascent or Ascent.from_candidates(self._plan[np.newaxis])
        start = known._replace(candidates=self._candidates(known.candidates))
        climbed = situation.climb(start, np.array([_RATE]), _SHARE)
        if climbed is not None:
            reached = climbed.ascent.candidates.copy()
            reached[:, 0] -= self._base
            self._ascent = climbed.ascent._replace(candidates=reached)

    def propose(self, gains: Sequence[Gain], random: np.random.Generator) -> np.ndarray:
        """The plan that is followed, and where the ascent has led [P, k, D]."""
        del gains, random
        ends = [] if self._ascent is None else [*self._ascent.candidates]
        return self._candidates(np.stack([self._plan, *ends]))

    def followed(self, base: np.ndarray) -> np.ndarray | None:
        """The plan, where it adds anything."""
        if not np.any(self._plan):
            return None
        self._base = base
        return self._candidates(self._plan[np.newaxis])[0]

    def shift(self, chosen: np.ndarray) -> None:
        """The rest of the plan that was played, and of the ascent."""
        chosen = chosen[np.newaxis, : self.depth]
        self._plan = one_step_later(chosen)[0]
        if self._ascent is None:
            return
        is_end = np.array_equal(self._candidates(self._ascent.candidates), chosen)
        self._refused = 0 if is_end else self._refused + 1
        goes_on = self._refused < _MOST_REFUSED
        self._ascent = self._ascent.changed(one_step_later) if goes_on else None
        self._refused %= _MOST_REFUSED

    def _candidates(self, additions: np.ndarray) -> np.ndarray:
        return candidates_of(additions, self._base, self._components)
