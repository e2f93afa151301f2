"""Changes of single components, and of two, where joint actions are too many to list."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mdpo_rddl.policy.lookahead.base import Gain, Situation
from mdpo_rddl.policy.lookahead.components import Components, some
from mdpo_rddl.policy.lookahead.one_step import OneStep

_MOST_PROPOSALS = 600
# the best changes are also tried together, so many at once
_TOGETHER = (2, 3, 4, 6, 8)


@dataclass
class Coordinate(OneStep):
    """Changes one component of the best action so far, or exchanges two, and so on.

    Gains are kept: the next round begins at the best action of the last one, and the changes that
    gained are tried together.
    """

    name: str = "coordinate-wise"
    rounds: int = 3
    _components: Components | None = field(default=None, init=False)
    _base: np.ndarray = field(default_factory=lambda: np.zeros(0), init=False)

    def applies(self, components: Components) -> bool:
        """Some component can be changed."""
        self._components = components
        return bool(components.changeable)

    def begin(self, situation: Situation) -> None:
        """Starts at the policy's action."""
        self._base = situation.base

    def propose(self, gains: Sequence[Gain], random: np.random.Generator) -> np.ndarray:
        """Neighbours of the best action so far, [P, 1, D]."""
        better = [gain for gain in gains if gain.mean > 0.0]
        if gains and not better:
            return np.zeros((0, 1, len(self._base)), np.float32)
        centre = better[0].candidate[0] if better else self._base
        together = self._together([gain.candidate[0] for gain in better])
        near = self._neighbours(centre, _MOST_PROPOSALS - len(together), random)
        proposals = np.concatenate([together, near])
        _, first = np.unique(proposals, axis=0, return_index=True)
        kept = proposals[np.sort(first)]
        return kept[np.any(kept != self._base, axis=1)][:, np.newaxis].astype(np.float32)

    def _together(self, better: Sequence[np.ndarray]) -> np.ndarray:
        """The base with several of the changes that gained, the best ones first."""
        found = [self._base]
        for count in _TOGETHER:
            if count > len(better):
                break
            action = self._base.copy()
            for other in reversed(better[:count]):
                action = np.where(other != self._base, other, action)
            found.append(action)
        return np.array(found)

    def _neighbours(self, centre: np.ndarray, most: int, random: np.random.Generator) -> np.ndarray:
        """Single changes, and exchanges of one that is off its default for one that is not.

        The no-op and the centre first, then as many others as are wanted, drawn before they are
        built: of many components there are far more exchanges than can be tried.
        """
        parts = self._components
        assert parts is not None  # `applies` was asked first
        places = parts.changeable
        values = [(p, value) for p in places for value in parts.near(p, float(centre[p]))]
        on = [place for place in places if centre[place] != parts.noop[place]]
        leaving = [None, *on]
        drawn = some(len(values) * len(leaving), most - 2, random)
        found = [parts.noop, centre]
        for number in drawn:
            back, (place, value) = leaving[number // len(values)], values[number % len(values)]
            # an exchange is for one at its default
            if back is None or centre[place] == parts.noop[place]:
                start = centre if back is None else _with(centre, back, float(parts.noop[back]))
                found.append(_with(start, place, value))
        return np.array(found)


def _with(action: np.ndarray, place: int, value: float) -> np.ndarray:
    changed = action.copy()
    changed[place] = value
    return changed
