"""The episodes that the published returns are of.

JaxPlan's authors played twenty on the exact environment of pyRDDLGym 1 (branch ICAPS2024), which
seeds its episodes with the Fibonacci numbers unless it is told otherwise. So JaxPlan, GurobiPlan,
PROST and the no-op had the same random numbers at each time a decision, but where several fluents
of one level draw: their order changed from process to process. PROST was played by `RDDLSimAgent`,
which ended an episode one step before the horizon. DiSProD had later seeds, and PROST at IPPC 2014
other episodes. Sources: github.com/mike-gimelfarb/ICAPS2024Exp; `tools/published_noop.py` plays the
no-op with these seeds beside what they published.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

# of pyRDDLGym's seeds, reached in the 46th episode
_MODULUS = 2**31 - 1


def published_seeds(episodes: int) -> list[int]:
    """The environment's seed in each of the first episodes: 1, 2, 3, 5, 8, ..."""
    seeds, following = [], (1, 2)
    for _ in range(episodes):
        seeds.append(following[0])
        following = following[1], sum(following) % _MODULUS
    return seeds


@dataclass
class _Shorter:
    """Adds up an episode's discounted rewards, of some steps at most."""

    steps: int
    discount: float
    total: float = 0.0
    seen: int = 0

    def add(self, state: Mapping[str, Any], actions: Mapping[str, Any], reward: float) -> None:
        if self.seen < self.steps:
            self.total += self.discount**self.seen * reward
        self.seen += 1


@dataclass
class ShorterReturns:
    """Records of each episode what it returned before the last step of the horizon.

    Attributes:
      horizon: of the problem, in steps.
      discount: of the problem, per step.
    """

    horizon: int
    discount: float
    _episodes: list[_Shorter] = field(default_factory=list, init=False)

    def begin(self) -> _Shorter:
        """The recorder of the next episode."""
        self._episodes.append(_Shorter(self.horizon - 1, self.discount))
        return self._episodes[-1]

    @property
    def returns(self) -> list[float]:
        """Of each episode [episodes]."""
        return [episode.total for episode in self._episodes]
