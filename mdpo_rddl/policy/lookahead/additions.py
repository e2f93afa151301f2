"""What is added to the policy's actions at the next steps, as candidates, and one step later."""

import numpy as np

from mdpo_rddl.policy.lookahead.components import Components


def candidates_of(additions: np.ndarray, base: np.ndarray, parts: Components | None) -> np.ndarray:
    """Additions as candidates: the first is an action in its box.

    Args:
      additions: [P, k, D].
      base: the policy's action now [D].
      parts: of an action; known once a method was asked whether it applies.
    """
    assert parts is not None
    candidates = additions.astype(np.float32)
    candidates[:, 0] = np.clip(candidates[:, 0] + base, parts.lower, parts.upper)
    return candidates


def one_step_later(additions: np.ndarray) -> np.ndarray:
    """Additions [P, k, D] after the first step; nothing is added at the last one."""
    return np.pad(additions[:, 1:], ((0, 0), (0, 1), (0, 0)))
