"""Adaptations of weights, of which the latest goes on in another process."""

from collections.abc import Callable

import numpy as np

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.common.state import State
from mdpo_rddl.auto.search.cma import Adaptation, Evaluate
from mdpo_rddl.auto.search.weights import Weights

Attempt = Callable[[Callable[[State], None], State], bool]
"""Says whether a state could be restored."""


class Adapting:
    """The adaptations of an arm, one after the other."""

    def __init__(self, arena: Arena, attempt: Attempt) -> None:
        """Adapts nothing yet.

        Args:
          arena: what all arms have in common.
          attempt: restores a state, and says so if it does not fit.
        """
        self._arena, self._attempt = arena, attempt
        self._working: Adaptation | None = None
        self._resumed: State | None = None

    def state(self) -> State | None:
        """Of the adaptation at work, or what another process has left for the next one."""
        return self._resumed if self._working is None else self._working.state()

    @property
    def is_resumed(self) -> bool:
        """Whether the next adaptation goes on with a state."""
        return self._resumed is not None

    @property
    def found(self) -> np.ndarray | None:
        """The mean of the adaptation at work; None before its first iteration, and between two."""
        working = self._working
        return working.mean if working is not None and working.iterations else None

    def restore(self, state: State | None) -> None:
        """Has the next adaptation go on with a state, or begin if there is none."""
        self._resumed = state

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
        state, self._resumed = self._resumed, None
        if state is not None:
            self._attempt(adaptation.restore, state)
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
