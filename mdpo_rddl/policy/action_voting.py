"""Playing a partially observed problem by a vote over the belief of the state.

Each particle of the belief votes for the action that a policy of the underlying MDP plays in its
state: action voting, of Simmons and Koenig, "Probabilistic robot navigation in partially observable
environments" (1995). A vote takes milliseconds. Like QMDP it never acts only to learn something.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, random

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.filtering import ParticleFilter
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.start import initial_values
from mdpo_rddl.policy.lookahead.base import Prepared, Tabled, Vote, rollout_params
from mdpo_rddl.policy.lookahead.belief import Believer
from mdpo_rddl.policy.lookahead.table_lookup import TableLookup
from mdpo_rddl.policy.playable import step_keys
from mdpo_rddl.policy.recall import require_count

Tree = Mapping[str, Any]

_PARTICLES = 512
_HASH_SEED = 0


class ActionVoting:
    """Plays by a vote, as `mdpo_rddl.policy.playable.Playable` plays by itself.

    It follows one episode after the other, each from step 0 on. No result hangs on the clock.

    Attributes:
      vote: for who thinks on from what is elected.
    """

    def __init__(self, policy: Prepared, underlying: Prepared | Tabled) -> None:
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
        self._elect = _compiled_vote(policy.planner, underlying)
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


def _compiled_vote(planner: MDPOPlanner, underlying: Prepared | Tabled) -> Callable[..., Any]:
    """A function of a random key, a step and particles that gives the elected action."""
    fluents: dict[str, Any] = {}
    hyperparams: Tree = {}
    if isinstance(underlying, Tabled):
        try:
            lookup = TableLookup(underlying.table)
        except ValueError as error:
            raise InputError(f"the underlying MDP's policy cannot be played: {error}") from error
        play, params = lookup.policy, lookup.arrays
    else:
        own = underlying.planner
        if own.plan.history_dependent or own.preprocessor is not None:
            raise InputError("the underlying MDP's policy reads more than the state")
        play, params = underlying.rollout_policy, rollout_params(underlying)
        hyperparams = underlying.policy_hyperparams
        fluents = {n: jnp.asarray(v[0]) for n, v in initial_values(own).test.fluents.items()}
    is_joint = _is_joint(planner)

    def elect(key: Array, params: Any, step: Any, particles: dict[str, Array]) -> Tree:
        def choose(own_key: Array, particle: dict[str, Array]) -> Tree:
            state = {
                name: jnp.asarray(value, fluents[name].dtype) if name in fluents else value
                for name, value in particle.items()
            }
            return play(own_key, params, hyperparams, step, {**fluents, **state}, {})

        count = len(jax.tree.leaves(particles)[0])
        actions = jax.vmap(choose)(random.split(key, count), particles)
        flat = [jnp.reshape(value, (count, -1)).astype(jnp.float32) for value in actions.values()]
        place = elected(jnp.concatenate(flat, axis=1), is_joint)
        return {name: value[place] for name, value in actions.items()}

    compiled = jax.jit(elect)
    return lambda key, step, particles: compiled(key, params, step, particles)


def elected(votes: Array, is_joint: bool) -> Array:
    """Whose action is elected: the place of a vote.

    Args:
      votes: of P particles, over the D components of an action [P, D].
      is_joint: whether the action with the most votes is elected; else the one that is nearest to
        the median of each component, distances in standard deviations.
    """
    if is_joint:
        factors = random.bits(random.PRNGKey(_HASH_SEED), (votes.shape[1],), jnp.uint32) | 1
        bits = jax.lax.bitcast_convert_type(votes, jnp.uint32)
        codes = jnp.sum(bits * factors, axis=1, dtype=jnp.uint32)
        return jnp.argmax(jnp.sum(codes[:, None] == codes, axis=1))
    spread = jnp.std(votes, axis=0)
    weights = jnp.where(spread > 0.0, 1.0 / jnp.where(spread > 0.0, spread, 1.0), 0.0)
    away = jnp.abs(votes - jnp.median(votes, axis=0))
    return jnp.argmin(jnp.sum(weights * away, axis=1))


def _is_joint(planner: MDPOPlanner) -> bool:
    """Whether no action lies between others: one component may be set, or one is an object."""
    rddl = planner.rddl
    kinds = {rddl.variable_ranges[name] for name in rddl.action_fluents}
    is_single = rddl.max_allowed_actions == 1 and kinds == {"bool"}
    return is_single or not kinds <= {"bool", "int", "real"}
