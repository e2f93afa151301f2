"""What improves a policy at a decision: the interface of the methods."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mdpo_rddl.policy.lookahead.components import Components


@dataclass(frozen=True)
class Gain:
    """What a candidate returned more than the base on the same scenarios.

    Attributes:
      candidate: [k, D].
      mean: over the scenarios.
      error: the mean's standard error.
    """

    candidate: np.ndarray
    mean: float
    error: float


class Method(Protocol):
    """Proposes candidates for the state at hand.

    A candidate is an array [k, D] over an action's D components: the action to play, and what is
    added to the policy's real actions at the k - 1 steps after it. Illegal ones are left out by
    whoever asks.

    Attributes:
      name: for the summary.
      depth: number of steps k.
      rounds: how often it proposes at one decision.
    """

    @property
    def name(self) -> str:
        """For the summary."""

    @property
    def depth(self) -> int:
        """Number of steps k."""

    @property
    def rounds(self) -> int:
        """How often it proposes at one decision."""

    def applies(self, components: Components) -> bool:
        """Whether the problem's actions are of a kind that it can change."""

    def begin(self, base: np.ndarray) -> None:
        """A decision begins.

        Args:
          base: the prepared policy's action [D].
        """

    def propose(self, gains: Sequence[Gain], random: np.random.Generator) -> np.ndarray:
        """Candidates [P, k, D], the most promising first; none ends the search.

        Args:
          gains: of what was proposed last, the largest first; empty in the first round.
          random: source of random numbers.
        """

    def shift(self, chosen: np.ndarray) -> None:
        """One step was played: what is known moves on with it.

        Args:
          chosen: the candidate that was played [k, D].
        """

    def reset(self) -> None:
        """A new episode begins."""
