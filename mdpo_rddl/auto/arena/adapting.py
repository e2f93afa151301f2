"""Adaptations of weights by the arena's population."""

import numpy as np

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.search.cma import Adaptation, Evaluate
from mdpo_rddl.auto.search.weights import Weights


class Adapting:
    """The adaptations of an arm, one after the other."""

    def __init__(self, arena: Arena) -> None:
        """Adapts nothing yet.

        Args:
          arena: what all arms have in common.
        """
        self._arena = arena
        self._working: Adaptation | None = None

    @property
    def found(self) -> np.ndarray | None:
        """The mean of the adaptation at work; None before its first iteration, and between two."""
        working = self._working
        return working.mean if working is not None and working.iterations else None

    def run(self, weights: Weights, adaptation: Adaptation, until: float, first: int = 0) -> int:
        """Adapts weights.

        Args:
          weights: what the adaptation's vectors stand for.
          adaptation: that has not begun, or goes on.
          until: when to end, by the clock.
          first: number of its first generation, which has rollouts of its own.

        Returns:
          The number of iterations.
        """
        begun = adaptation.iterations
        self._working = adaptation
        adaptation.run(self.evaluation(weights, first), until)
        self._working = None
        return adaptation.iterations - begun

    def evaluation(self, weights: Weights, first: int) -> Evaluate:
        """What plays vectors of weights for a search, and can be interrupted between two calls.

        Args:
          weights: what the vectors stand for.
          first: number of the search's first iteration, which has rollouts of its own.
        """

        def evaluate(number: int, vectors: np.ndarray) -> np.ndarray:
            self._arena.pulse()
            return self._arena.population(weights, first + number, vectors)

        return evaluate
