"""Sampled and climbed additions to the policy's real actions, a few steps ahead."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mdpo_rddl.planner.climbing import Ascent
from mdpo_rddl.policy.lookahead.additions import Additions, one_step_later
from mdpo_rddl.policy.lookahead.base import Gain, Situation

_DEPTH = 40
# proposals of the rounds: fewer and nearer as the search goes on, but at least one call's
_POPULATIONS = (96, 64, 48, 32, 32, 32)
_ELITES = 8
# a sample's deviation, in units of the components: between a share of sigma and sigma
_SIGMA, _SMALLEST_SHARE = 0.3, 0.03
# power-law exponent of the noise over the steps, as in iCEM
_COLOUR = 2.0
# gradient steps: their share of the search's time, and their rates in units of the components
_CLIMBING_SHARE, _RATES = 0.5, (0.01, 0.1, 0.03, 0.003)
# so many samples change a discrete component of the first action
_DISCRETE_SHARE = 0.3


@dataclass
class Residuals(Additions):
    """Cross-entropy search over additions to the policy's actions, the policy afterwards.

    Coloured noise, elites that are kept and a mean that is shifted to the next step are those of
    iCEM (Pinneri et al., "Sample-efficient cross-entropy method for real-time planning", 2020).
    With gradient steps their ends are proposed as well.

    Attributes:
      adaptive: whether the noise of a step follows the return's sensitivity to its action, as in
        `AdaptiveNoise`; else it is the same at all steps. Only with gradient steps.
      climbs: whether gradient steps are made.
      depth: number of steps k.
    """

    name: str = "residuals"
    adaptive: bool = True
    climbs: bool = True
    depth: int = _DEPTH
    rounds: int = len(_POPULATIONS)
    is_for_chance: bool = True
    _climbed: np.ndarray = field(default_factory=lambda: np.zeros((0, 0, 0)), init=False)
    _sigma: np.ndarray = field(default_factory=lambda: np.zeros(0), init=False)
    _elites: list[Gain] = field(default_factory=list, init=False)
    _round: int = field(default=0, init=False)
    _capacity: int = field(default=0, init=False)

    def reset(self) -> None:
        """The plan of a new episode adds nothing."""
        super().reset()
        self._climbed = self._plan[np.newaxis][:0]

    def begin(self, situation: Situation) -> None:
        """Climbs from the policy's actions and from the plan that is known."""
        self._base, self._round, self._capacity = situation.base, 0, situation.capacity
        self._sigma = np.full(self.depth, _SIGMA)
        self._elites = []
        if not self.climbs:
            return
        zero = np.zeros_like(self._plan)
        last = self._climbed[-1] if len(self._climbed) else zero
        starts = self._candidates(np.stack([self._plan, self._plan, last, zero]))
        count = situation.climbers
        ascent = Ascent.from_candidates(starts[:count])
        climbed = situation.climb(ascent, np.array(_RATES[:count]), _CLIMBING_SHARE)
        if climbed is None:
            self._climbed = self._climbed[:0]
            return
        self._climbed = self._additions(climbed.ascent.candidates)
        if self.adaptive:
            self._sigma = _SIGMA * climbed.sigma[0]

    def propose(self, gains: Sequence[Gain], random: np.random.Generator) -> np.ndarray:
        """Candidates [P, k, D]: the plans that are known, then samples around the best."""
        number, self._round = self._round, self._round + 1
        if number == 0:
            zero = np.zeros_like(self._plan)
            centres, known = np.stack([zero, self._plan]), [self._plan, *self._climbed]
        else:
            centres = self._best(gains)
            known = [self._mean(centres), self._mean(centres[: max(1, len(centres) // 2)])]
        count = max(_POPULATIONS[number], self._capacity - len(known))
        count = min(count, self._parts.most_candidates(self.depth))
        around = centres[random.integers(len(centres), size=count)]
        scale = 0.5**number * _SMALLEST_SHARE ** random.random((count, 1, 1), np.float32)
        samples = around + scale * self._noise(random, count)
        proposals = self._candidates(np.concatenate([np.stack(known), samples]))
        return self._with_discrete_changes(proposals, random, len(known))

    def _best(self, gains: Sequence[Gain]) -> np.ndarray:
        """Additions of the elites of all rounds, the largest gain first [E, k, D]."""
        better = [gain for gain in gains[:_ELITES] if gain.mean > 0.0]
        self._elites = sorted([*self._elites, *better], key=lambda gain: -gain.mean)[:_ELITES]
        if not self._elites:
            return np.zeros_like(self._plan)[np.newaxis]
        return self._additions(np.stack([gain.candidate for gain in self._elites]))

    def _mean(self, centres: np.ndarray) -> np.ndarray:
        """Of additions [E, k, D]; what is no real as in the first of them [k, D]."""
        return np.where(self._parts.is_real, centres.mean(axis=0), centres[0])

    def _noise(self, random: np.random.Generator, count: int) -> np.ndarray:
        """Coloured noise on some of the components [P, k, D], in their own values."""
        parts = self._parts
        white = random.standard_normal((count, self.depth, parts.size), np.float32)
        frequencies = np.maximum(np.fft.rfftfreq(self.depth), 1.0 / self.depth)
        weights = (frequencies ** (-_COLOUR / 2.0)).astype(np.float32)
        coloured = np.fft.irfft(
            np.fft.rfft(white, axis=1) * weights[:, np.newaxis], self.depth, axis=1
        )
        coloured /= np.maximum(coloured.std(axis=(0, 1), keepdims=True), 1e-9)
        chosen = random.random((count, 1, parts.size)) < random.random((count, 1, 1))
        chosen[: count // 2] = True
        coloured *= chosen
        coloured *= (self._sigma[:, np.newaxis] * parts.units).astype(np.float32)
        return coloured

    def _with_discrete_changes(
        self, candidates: np.ndarray, random: np.random.Generator, known: int
    ) -> np.ndarray:
        """Changes one discrete component of the first action of some samples."""
        parts = self._parts
        if parts.discrete:
            for candidate in candidates[known:]:
                if random.random() < _DISCRETE_SHARE:
                    place = int(random.choice(parts.discrete))
                    candidate[0, place] = random.choice(parts.values[place])
        return candidates

    def shift(self, chosen: np.ndarray) -> None:
        """The rest of the plan that was played."""
        super().shift(chosen)
        self._climbed = one_step_later(self._climbed, chosen)
