"""What a policy returns: episodes on the simulator that are the same for all policies."""

from typing import Any, Protocol

import numpy as np

from mdpo_rddl.problem.evaluation import lost_worth
from mdpo_rddl.simulator.evaluation import Replicated
from mdpo_rddl.simulator.rollouts import rollout
from mdpo_rddl.simulator.simulator import Simulator, State

BLOCK = 128
"""Episodes that are played together, from numbers of their own."""


class Replicable(Protocol):
    """A policy that can decide for many episodes at once."""

    def replicated(self) -> Replicated | None:
        """What decides; None where it cannot."""


class Evaluator:
    """Plays policies.

    Episode n of any two policies has the same random numbers, as far as they draw alike. An episode
    that cannot be played to its end, since the environment raises an error or no action is legal,
    is worth `lost_worth` of the share of its steps that is missing: less than any return, and the
    less, the earlier.
    """

    def __init__(self, simulator: Simulator, seed: int) -> None:
        """Plays nothing yet.

        Args:
          simulator: of the problem.
          seed: of the episodes.
        """
        self.simulator, self._seed = simulator, seed

    def returns(self, policy: Any, episodes: int, first: int = 0, stream: int = 0) -> np.ndarray:
        """The worth of episodes [episodes].

        Args:
          policy: a `Replicated`.
          episodes: how many.
          first: number of the first one, a multiple of `BLOCK`.
          stream: other ones have other episodes: 0 is the race's, 1 confirms its result.
        """
        blocks = range(first // BLOCK, -(-(first + episodes) // BLOCK))
        parts = []
        for number in blocks:
            count = min(BLOCK, first + episodes - number * BLOCK)
            # always of one size, so that an episode's numbers do not depend on how many are played
            seed = [self._seed, stream, number]
            parts.append(worth(self.simulator, policy, BLOCK, seed)[:count])
        return np.concatenate(parts) if parts else np.zeros(0)


def worth(simulator: Simulator, policy: Any, episodes: int | State, seed: Any) -> np.ndarray:
    """The worth [B] of episodes of a `Replicated` policy; see `Evaluator`."""
    told = getattr(policy, "were_played", None)

    def play(step: int, observation: Any) -> Any:
        actions = policy(step, observation)
        if told is not None:
            told(actions)
        return actions

    found = rollout(simulator, play, episodes, seed)
    horizon = simulator.problem.horizon
    missing = 1.0 - found.lengths / horizon
    lost = found.errors
    returns = np.where(np.isfinite(found.returns), found.returns, -np.inf)
    return np.where(lost, lost_worth(missing), returns)
