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

    def followed(self, base: np.ndarray) -> np.ndarray | None:
        """The plan, where it adds anything."""
        self._base = base
        if not np.any(self._plan):
            return None
        return self._candidates(self._plan)

    def shift(self, chosen: np.ndarray) -> None:
        """The rest of the plan that was played."""
        self._plan = one_step_later(chosen[np.newaxis], self.depth)[0]

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


def one_step_later(additions: np.ndarray, depth: int) -> np.ndarray:
    """Additions [P, n, D] at so many steps after the first; nothing is added after the last."""
    later = additions[:, 1 : depth + 1]
    return np.pad(later, ((0, 0), (0, depth - later.shape[1]), (0, 0)))
