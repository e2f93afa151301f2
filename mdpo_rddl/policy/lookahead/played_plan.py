"""The plan that an episode follows, to the horizon; kept for the same episode."""

from dataclasses import dataclass, field

import numpy as np

from mdpo_rddl.policy.lookahead.components import Components


@dataclass
class PlayedPlan:
    """How the policy's actions are changed at all steps to come, and were changed so far.

    A method changes the next k steps of it. What comes after them is of an earlier episode: where
    nothing is random the next episode is the same one, as long as the same actions are played.

    Attributes:
      depth: number of steps n of a whole plan, at least k.
      components: of an action, D of them.
    """

    depth: int
    components: Components
    _rest: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)), init=False)
    _played: list[np.ndarray] = field(default_factory=list, init=False)
    _first: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self.forget()

    @property
    def step(self) -> int:
        """The number of the next decision."""
        return self._first + len(self._played)

    def forget(self, step: int = 0) -> None:
        """Nothing is known of an episode whose next decision is the one at this step."""
        self._rest = np.zeros((self.depth, self.components.size), np.float32)
        self._played, self._first = [], step

    def begin_again(self) -> np.ndarray:
        """The latest episode begins again: what was changed, and was still to be, in it [n, D].

        Nothing where its beginning is not known.
        """
        if self._first > 0:
            self.forget()
        known = np.concatenate([np.reshape(self._played, (-1, self.components.size)), self._rest])
        self._rest, self._played = known[: self.depth].astype(np.float32), []
        return self._rest

    def followed(self, base: np.ndarray) -> np.ndarray | None:
        """What is left of the plan as a candidate [n, D]; None where it changes nothing.

        Args:
          base: the prepared policy's action now [D].
        """
        if not np.any(self._rest):
            return None
        plan = self._rest.copy()
        plan[0] = self.components.changed(plan[0], base)
        return plan

    def padded(self, candidates: np.ndarray) -> np.ndarray:
        """Candidates of fewer steps [P, k, D], and what is planned after these [P, n, D]."""
        after = self._rest[candidates.shape[1] :]
        return np.concatenate([candidates, np.tile(after, (len(candidates), 1, 1))], axis=1)

    def shift(self, chosen: np.ndarray, base: np.ndarray) -> None:
        """The first step of a plan is played.

        Args:
          chosen: the candidate that it is of [n, D].
          base: the prepared policy's action [D].
        """
        self._played.append(self.components.changes(chosen[0], base))
        self._rest = np.pad(chosen[1:], ((0, 1), (0, 0)))

    def replace(self, action: np.ndarray, base: np.ndarray) -> None:
        """Another action than the plan's was played at the latest step.

        Args:
          action: that was played [D].
          base: the prepared policy's [D].
        """
        self._played[-1] = self.components.changes(action, base)
