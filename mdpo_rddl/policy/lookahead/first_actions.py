"""All first actions, where they are few."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mdpo_rddl.policy.lookahead.base import Gain, Situation
from mdpo_rddl.policy.lookahead.components import Components
from mdpo_rddl.policy.lookahead.one_step import OneStep

_MOST_ACTIONS = 400


@dataclass
class FirstActions(OneStep):
    """Every joint action at once, the policy afterwards.

    The rollout algorithm: one step of policy improvement at the state at hand (Bertsekas,
    Tsitsiklis and Wu, "Rollout algorithms for combinatorial optimization", 1997).
    """

    name: str = "first actions"
    rounds: int = 1
    _actions: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)), init=False)
    _base: np.ndarray = field(default_factory=lambda: np.zeros(0), init=False)

    def applies(self, components: Components) -> bool:
        """Lists the actions, if they are few."""
        if not 1 < components.joint_actions <= _MOST_ACTIONS:
            return False
        actions = []
        for count in range(components.most + 1):
            for places in itertools.combinations(components.discrete, count):
                others = [
                    [v for v in components.values[place] if v != components.noop[place]]
                    for place in places
                ]
                for values in itertools.product(*others):
                    action = components.noop.copy()
                    action[list(places)] = values
                    actions.append(action)
        self._actions = np.array(actions, np.float32)
        return True

    def begin(self, situation: Situation) -> None:
        """Leaves the policy's own action out."""
        self._base = situation.base

    def propose(self, gains: Sequence[Gain], random: np.random.Generator) -> np.ndarray:
        """All actions but the policy's, in random order, [P, 1, D]."""
        if gains:
            return np.zeros((0, 1, len(self._base)), np.float32)
        differs = np.any(self._actions != self._base, axis=1)
        return random.permutation(self._actions[differs])[:, np.newaxis]
