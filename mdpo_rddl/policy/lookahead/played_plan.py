"""The plan that an episode follows, to the horizon; kept for the same episode."""

from dataclasses import dataclass, field

import numpy as np

from mdpo_rddl.policy.lookahead.components import Components


@dataclass
class PlayedPlan:
    """How the policy's actions are changed at each step: at those to come, and so far.

    A method changes the next k steps of it. What comes after them is of an earlier episode: where
    nothing is random the next episode is the same one, as long as the same actions are played.

    Attributes:
      depth: steps n of a candidate, at least k.
      horizon: steps of an episode.
      components: of an action, D of them.
    """

    depth: int
    horizon: int
    components: Components
    _changes: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)), init=False)
    _step: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self.forget()

    @property
    def step(self) -> int:
        """The number of the next decision."""
        return self._step

    @property
    def rest(self) -> np.ndarray:
        """How the policy's actions are to be changed, the next one too [n, D]."""
        return self._changes[self._step : self._step + self.depth].copy()

    def forget(self) -> None:
        """Nothing is known, and an episode begins."""
        # candidates reach beyond the horizon, where nothing counts
        steps = self.horizon + self.depth
        self._changes, self._step = np.zeros((steps, self.components.size), np.float32), 0

    def go_to(self, step: int) -> None:
        """The next decision is the one at this step; all that is known stays."""
        self._step = min(step, self.horizon)

    def followed(self, base: np.ndarray) -> np.ndarray | None:
        """What is left of the plan as a candidate [n, D]; None where it changes nothing.

        Args:
          base: the prepared policy's action now [D].
        """
        plan = self.rest
        if not np.any(plan):
            return None
        plan[0] = self.components.changed(plan[0], base)
        return plan

    def padded(self, candidates: np.ndarray) -> np.ndarray:
        """Candidates of fewer steps [P, k, D], and what is planned after these [P, n, D]."""
        after = self.rest[candidates.shape[1] :]
        return np.concatenate([candidates, np.tile(after, (len(candidates), 1, 1))], axis=1)

    def shift(self, chosen: np.ndarray, base: np.ndarray) -> None:
        """The first step of a plan is played, and nothing else is planned after its last one.

        Args:
          chosen: the candidate that it is of [n, D].
          base: the prepared policy's action [D].
        """
        now = self._step
        self._changes[now:] = 0.0
        self._changes[now : now + self.depth] = chosen
        self._changes[now] = self.components.changes(chosen[0], base)
        self.go_to(now + 1)

    def replace(self, action: np.ndarray, base: np.ndarray) -> None:
        """Another action than the plan's was played at the latest step.

        Args:
          action: that was played [D].
          base: the prepared policy's [D].
        """
        self._changes[self._step - 1] = self.components.changes(action, base)
