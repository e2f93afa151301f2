"""Playing a partially observed problem by a vote over the belief of the state.

The particles of a filter elect the action, in compiled code (`mdpo_rddl.policy.electing`) or by
relaxed plans (`mdpo_rddl.policy.electing_by_plans`).
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from mdpo_rddl.planner.exact.filtering import ParticleFilter
from mdpo_rddl.policy.electing import compiled_election
from mdpo_rddl.policy.electing_by_plans import election_by_plans
from mdpo_rddl.policy.formula import require_count
from mdpo_rddl.policy.lookahead.base import ByPlans, Prepared, Tabled, Vote
from mdpo_rddl.policy.lookahead.belief import Believer
from mdpo_rddl.policy.playable import step_keys

Tree = Mapping[str, Any]

_PARTICLES = 2048


class ActionVoting:
    """Plays by a vote, as `mdpo_rddl.policy.playable.Playable` plays by itself.

    It follows one episode after the other, each from step 0 on. No result hangs on the clock.

    Attributes:
      vote: for who thinks on from what is elected.
    """

    def __init__(self, policy: Prepared, underlying: Prepared | Tabled | ByPlans) -> None:
        """Compiles nothing yet.

        Args:
          policy: of a problem whose state is observed in part only.
          underlying: a policy of the underlying MDP.

        Raises:
          InputError: if the underlying policy cannot be played in compiled code.
        """
        self._planner = policy.planner
        own = ParticleFilter(policy.planner)
        self.vote = Vote(self._elected, _PARTICLES, own)
        self._one = Believer(policy, particles=_PARTICLES, attempts_seconds=math.inf, filter=own)
        self._many: list[Believer] = []
        self._step = -1
        self._keys = step_keys(policy.planner, policy.seed)
        if isinstance(underlying, ByPlans):
            self._elect = election_by_plans(underlying)
        else:
            with policy.planner.computing():
                self._elect = compiled_election(policy.planner, underlying)
        self._noop = {
            name: np.asarray(policy.planner.test_compiled.init_values[name])
            for name in policy.planner.rddl.action_fluents
        }

    def _elected(self, step: int, particles: Tree) -> dict[str, Any]:
        with self._planner.computing():
            found = self._elect(self._keys[step], step, dict(particles))
            actions = {
                name: np.asarray(found[name]).astype(like.dtype)
                for name, like in self._noop.items()
            }
            return self._planner.clipped(actions)

    def __call__(self, step: int, observation: Tree) -> dict[str, Any]:
        """The action per fluent [*shape] at a step, for an observation per fluent."""
        return self._decided(self._one, step, observation)

    def was_played(self, actions: Tree) -> None:
        """Takes in what was played at the latest step, where it is not what was elected.

        Args:
          actions: per action fluent [*shape].
        """
        if (belief := self._one.now) is not None:
            self._one.played(belief, actions)

    def batch(self, step: int, observations: Tree) -> dict[str, np.ndarray]:
        """The actions for the observations of several episodes at one step.

        Args:
          step: number of decisions before.
          observations: per fluent its values [batch, *shape].

        Raises:
          InputError: if the step follows the last one, which was of another number of episodes.
        """
        count = len(next(iter(observations.values())))
        if step == 0 or step not in (self._step, self._step + 1):
            self._many = [self._one.anew() for _ in range(count)]
        self._step = step
        require_count(len(self._many), count, step)
        decided = [
            self._decided(believer, step, {n: v[place] for n, v in observations.items()})
            for place, believer in enumerate(self._many)
        ]
        return {name: np.stack([each[name] for each in decided]) for name in self._noop}

    def reset(self) -> None:
        """Forgets the episodes."""
        self._one, self._many, self._step = self._one.anew(), [], -1

    def _decided(self, believer: Believer, step: int, observation: Tree) -> dict[str, Any]:
        with self._planner.computing():
            belief = believer.believe(step, observation)
        action = self._elected(step, belief.root.particles)
        believer.played(belief, action)
        return action
