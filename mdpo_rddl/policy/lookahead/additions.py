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
        assert self._components is not None  # `applies` was asked first
        self._plan = np.zeros((self.depth, self._components.size), np.float32)

    def followed(self, base: np.ndarray) -> np.ndarray | None:
        """The plan, where it adds anything."""
        if not np.any(self._plan):
            return None
        self._base = base
        return self._candidates(self._plan[np.newaxis])[0]

    def shift(self, chosen: np.ndarray) -> None:
        """The rest of the plan that was played."""
        self._plan = one_step_later(chosen[np.newaxis, : self.depth])[0]

    def _candidates(self, additions: np.ndarray) -> np.ndarray:
        """Additions [P, k, D] as candidates: the first is an action in its box."""
        parts = self._components
        assert parts is not None
        candidates = additions.astype(np.float32)
        candidates[:, 0] = np.clip(candidates[:, 0] + self._base, parts.lower, parts.upper)
        return candidates


def one_step_later(additions: np.ndarray) -> np.ndarray:
    """Additions [P, k, D] after the first step; nothing is added at the last one."""
    return np.pad(additions[:, 1:], ((0, 0), (0, 1), (0, 0)))
