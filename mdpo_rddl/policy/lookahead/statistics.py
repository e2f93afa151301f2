"""Figures of the decisions that were made while playing."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from mdpo_rddl.policy.lookahead.driver import Decision


def decision_figures(decisions: Sequence[Decision], budget: float, episodes: int) -> dict[str, Any]:
    """How long decisions took and what they expected to gain, as JSON can hold it.

    Args:
      decisions: of all episodes.
      budget: seconds of a decision.
      episodes: how many were played.
    """
    seconds = np.array([decision.seconds for decision in decisions] or [0.0])
    return {
        "decisions": len(decisions),
        "left_base": sum(decision.left_base for decision in decisions),
        "replaced": sum(decision.replaced for decision in decisions),
        "mean_seconds": float(seconds.mean()),
        "p99_seconds": float(np.quantile(seconds, 0.99)),
        "max_seconds": float(seconds.max()),
        "within_budget": float(np.mean(seconds <= 1.1 * budget)),
        "unmatched_beliefs": sum(decision.unmatched for decision in decisions),
        "expected_gain": sum(decision.gain for decision in decisions) / max(1, episodes),
    }
