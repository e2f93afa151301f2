"""A plan of additions to the policy's actions at the next steps; it moves on with the episode."""

from dataclasses import dataclass, field

import numpy as np

from mdpo_rddl.policy.lookahead.components import Components


@dataclass
class Additions:
    """What methods have in common that add to real actions, several steps ahead.

    Attributes:
      depth: number of steps k.
    """

    depth: int
    _components: Components | None = field(default=None, init=False)
    _base: np.ndarray = field(default_factory=lambda: np.zeros(0), init=False)
    _plan: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)), init=False)

    def applies(self, components: Components) -> bool:
        """Some component is real."""
        self._components = components
        self.reset()
        return bool(np.any(components.is_real))

    def reset(self) -> None:
        """The plan of a new episode adds nothing."""
        self._plan = np.zeros((self.depth, self._parts.size), np.float32)

    def resume(self, changes: np.ndarray) -> None:
        """An episode begins with a plan."""
        self.reset()
        self._plan = changes[: self.depth].astype(np.float32)

    def shift(self, chosen: np.ndarray) -> None:
        """The rest of the plan that was played."""
        self._plan = one_step_later(chosen[np.newaxis, : self.depth], chosen)[0]

    def _candidates(self, additions: np.ndarray) -> np.ndarray:
        """Additions [..., k, D] as candidates: the first is an action in its box."""
        candidates = additions.astype(np.float32)
        candidates[..., 0, :] = self._parts.changed(candidates[..., 0, :], self._base)
        return candidates

    def _additions(self, candidates: np.ndarray) -> np.ndarray:
        """Candidates [..., k, D] as additions, to the first action too."""
        additions = candidates[..., : self.depth, :].copy()
        additions[..., 0, :] = self._parts.changes(additions[..., 0, :], self._base)
        return additions

    @property
    def _parts(self) -> Components:
        assert self._components is not None  # `applies` was asked first
        return self._components


def one_step_later(additions: np.ndarray, plan: np.ndarray) -> np.ndarray:
    """Additions [P, k, D] after the first step.

    Args:
      additions: to be moved on.
      plan: that is followed [n, D], whose step after the additions' last is their new last one.
    """
    depth = additions.shape[1]
    later = np.pad(additions[:, 1:], ((0, 0), (0, 1), (0, 0)))
    later[:, -1] = plan[depth] if depth < len(plan) else 0.0
    return later
