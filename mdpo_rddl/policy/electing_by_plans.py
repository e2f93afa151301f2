"""What to play in a belief, from relaxed plans of the underlying MDP.

A plan takes milliseconds, so that plans are made in the most likely states alone. Each votes for
its action with as many voices as there are particles in its state: action voting
(`mdpo_rddl.policy.electing`), of whole actions.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jax import Array

from mdpo_rddl.policy.electing import Elect
from mdpo_rddl.policy.lookahead.base import ByPlans

_MOST_STATES, _SEED = 8, 0


def election_by_plans(underlying: ByPlans) -> Elect:
    """What says which action to play in a belief.

    Args:
      underlying: makes plans of the underlying MDP.
    """

    def elect(key: Array, step: Any, particles: Mapping[str, Any]) -> Mapping[str, Any]:
        del key  # what plans draw depends on the step alone
        states = {name: np.asarray(each) for name, each in particles.items()}
        _, first, counts = np.unique(_rows(states), axis=0, return_index=True, return_counts=True)
        # states come in the order of their values, which says nothing where many are as likely
        shuffled = np.random.default_rng(_SEED).permutation(len(counts))
        likely = shuffled[np.argsort(-counts[shuffled], kind="stable")][:_MOST_STATES]
        tried = {name: each[first[likely]] for name, each in states.items()}
        actions = underlying.actions_in(int(step), tried)
        _, place, same = np.unique(_rows(actions), axis=0, return_index=True, return_inverse=True)
        elected = place[np.argmax(np.bincount(same.ravel(), counts[likely]))]
        return {name: each[elected] for name, each in actions.items()}

    return elect


def _rows(values: Mapping[str, np.ndarray]) -> np.ndarray:
    """Values per fluent [N, *shape] as rows [N, D]."""
    return np.concatenate([each.reshape(len(each), -1) for each in values.values()], axis=1)
