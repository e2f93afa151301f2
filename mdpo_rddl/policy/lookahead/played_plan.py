"""The plan that an episode follows, beyond what a method changes; kept for the same episode."""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class PlayedPlan:
    """How the policy's actions are changed at all steps to come, and were changed so far.

    A method changes the next k steps of it. What comes after them is of an earlier episode: where
    nothing is random the next episode is the same one, as long as the same actions are played.

    Attributes:
      depth: number of steps n of a whole plan, at least k.
      size: of a step's changes, D.
    """

    depth: int
    size: int
    _rest: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)), init=False)
    _played: list[np.ndarray] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Nothing is known of the episode that begins."""
        self._rest, self._played = np.zeros((self.depth, self.size), np.float32), []

    def begin_again(self) -> np.ndarray:
        """The latest episode begins again: what was changed in it [n, D]."""
        played = np.array(self._played[: self.depth]).reshape(-1, self.size)
        self.forget()
        self._rest[: len(played)] = played
        return self._rest

    def padded(self, candidates: np.ndarray) -> np.ndarray:
        """Candidates of fewer steps [P, k, D], and what is planned after these [P, n, D]."""
        after = self._rest[candidates.shape[1] :]
        return np.concatenate([candidates, np.tile(after, (len(candidates), 1, 1))], axis=1)

    def shift(self, chosen: np.ndarray, changes: np.ndarray) -> None:
        """The first step of a plan is played.

        Args:
          chosen: the candidate that it is of [n, D].
          changes: of the policy's action at this step [D].
        """
        self._played.append(changes)
        self._rest = np.pad(chosen[1:], ((0, 1), (0, 0)))
