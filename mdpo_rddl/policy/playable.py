"""A policy as it is played: from a step and an observation to an action."""

import hashlib
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from pyRDDLGym.core.compiler.model import RDDLLiftedModel

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.rollouts.plan_memory import Entries
from mdpo_rddl.policy.recall import Recall
from mdpo_rddl.problem.observation import as_numbers


class Playable:
    """The policy with the given parameters, as `mdpo_rddl.problem.evaluation` plays it.

    A policy that remembers plays one episode after the other, each from step 0 on.
    """

    def __init__(
        self, planner: MDPOPlanner, params: Any, policy_hyperparams: Mapping[str, Any], seed: int
    ) -> None:
        """Remembers nothing yet.

        Args:
          planner: the planner that the parameters belong to.
          params: parameters of one policy.
          policy_hyperparams: JaxPlan's policy hyperparameters.
          seed: of a policy that draws random numbers, see `decision_key`.
        """
        self._planner, self._params = planner, params
        self._hyperparams = dict(policy_hyperparams)
        self._keys = step_keys(planner, seed)
        self._one, self._many = Recall(planner), Recall(planner)
        self._seen: Mapping[str, Any] = {}
        self._seen_by_many: Mapping[str, Any] = {}
        self._noted: Mapping[str, Any] = {}

    def __call__(self, step: int, state: Mapping[str, Any]) -> Mapping[str, Any]:
        """The action tensor per fluent at a step, for an observation per fluent."""
        memory = self.memory_at(step)
        each = {name: np.asarray(value)[np.newaxis] for name, value in state.items()}
        seen = self._one.shown(step, each, 1)
        key = decision_key(self._planner.rddl, self._keys[step], _of_one(seen, 0))
        given = key, self._params, step, dict(state), self._hyperparams
        actions = self._planner.get_action(*given, *([memory] if memory else []))
        if memory:
            self._seen = seen
            self._note(actions)
        return actions

    def was_played(self, actions: Mapping[str, Any]) -> None:
        """Takes in what was played at the latest step, where it is not what the policy decided.

        Args:
          actions: per action fluent [*shape].
        """
        if not self._noted:
            return
        own = self._noted
        numbers = {name: self._planner.numbers(name, actions[name]) for name in own}
        if not all(np.array_equal(numbers[name], value) for name, value in own.items()):
            self._note(numbers)

    def _note(self, actions: Mapping[str, Any]) -> None:
        self._noted = {name: np.asarray(value) for name, value in actions.items()}
        self._one.note(self._seen, {n: value[np.newaxis] for n, value in self._noted.items()})

    def memory_at(self, step: int) -> Entries:
        """What is remembered when a step's action is chosen, per entry [*shape]."""
        return jax.tree.map(lambda leaf: leaf[0], self._one.at(step, 1))

    def batch(self, step: int, observations: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """The actions for the observations of several episodes at one step, in one call.

        Args:
          step: number of decisions before.
          observations: per fluent its values [batch, *shape].

        Raises:
          InputError: if a policy that remembers is given another number than at the step before.
        """
        count = len(next(iter(observations.values())))
        memories, seen = self._many.at(step, count), self._many.shown(step, observations, count)
        key, each = self._keys[step], (_of_one(seen, number) for number in range(count))
        keys = np.stack([decision_key(self._planner.rddl, key, one) for one in each])
        given = keys, self._params, step, seen, self._hyperparams
        actions = self._planner.get_actions(*given, memories)
        self._seen_by_many = seen
        self._many.note(seen, actions)
        return actions

    def were_played(self, actions: Mapping[str, np.ndarray]) -> None:
        """Takes in what was played at the latest step of `batch`, per action fluent.

        Args:
          actions: per action fluent [batch, *shape].
        """
        self._many.note(self._seen_by_many, actions)

    def reset(self) -> None:
        """Forgets the episodes."""
        self._seen = self._noted = {}
        self._one.reset()
        self._many.reset()


def playable(
    planner: MDPOPlanner, params: Any, policy_hyperparams: Mapping[str, Any], seed: int
) -> Playable:
    """`Playable` with these arguments."""
    return Playable(planner, params, policy_hyperparams, seed)


def decision_key(
    model: RDDLLiftedModel, key: np.ndarray, observation: Mapping[str, Any]
) -> np.ndarray:
    """The random key of a decision [2]: the step's, changed by what is observed.

    A policy that draws decides alike where it sees the same at the same step, in all episodes, and
    otherwise independently of what it drew there.

    Args:
      model: of the problem, lifted.
      key: of the step [2].
      observation: per fluent its values [*shape].
    """
    digest = hashlib.blake2b(digest_size=key.nbytes)
    for name in sorted(observation):
        # a fluent may be shown in another type after a step than after a reset
        values = as_numbers(model, name, observation[name])
        digest.update(np.asarray(values, np.float64).tobytes())
    return key ^ np.frombuffer(digest.digest(), key.dtype)


def _of_one(observations: Mapping[str, Any], number: int) -> dict[str, Any]:
    """What is observed in one of several episodes."""
    return {name: values[number] for name, values in observations.items()}


def step_keys(planner: MDPOPlanner, seed: int) -> np.ndarray:
    """The random key of each step, as a policy of that seed is played [steps, 2]."""
    steps = max(planner.horizon, planner.rddl.horizon)
    return np.asarray(jax.random.split(jax.random.PRNGKey(seed), steps))
