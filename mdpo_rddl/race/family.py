"""The feedback policies of a problem: one configuration, one formula, many parameters."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.plans.feedback_actions import FeedbackActions
from mdpo_rddl.policy.formula import FeedbackFormula
from mdpo_rddl.policy.policy import Compiled, Policy
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.race.evaluator import Check, worth
from mdpo_rddl.race.weights import Params, Weights, completed
from mdpo_rddl.simulator.simulator import Simulator


class Family:
    """All feedback policies that a configuration describes.

    Attributes:
      config: of a planner of theirs.
      feedback: their raw actions, see `Feedback`.
      noop: parameters that play the no-op.
    """

    def __init__(
        self,
        problem: Problem,
        simulator: Simulator,
        config: PlannerConfig,
        seed: int,
        check: Check,
    ) -> None:
        """Builds the formula.

        Args:
          problem: the problem.
          simulator: of it.
          config: with a `FeedbackPlan`.
          seed: of hidden units, and of the policies.
          check: called at each step of rollouts; what it raises passes through.
        """
        self.config, self._problem, self._simulator, self._seed = config, problem, simulator, seed
        self._check = check
        self._formula = FeedbackFormula(problem, config, simulator)
        self.feedback = self._formula.actions.feedback
        self.noop: Params = self.feedback.initial(np.random.default_rng(seed))

    def policy(self, params: Params) -> Policy:
        """The policy with these parameters, of which parts that have no effect may be missing."""
        full = completed(params, self.noop)
        compiled = Compiled(formula=self._formula)
        return Policy(self._problem, self.config, full, {}, self._seed, compiled=compiled)

    @property
    def actions(self) -> FeedbackActions:
        """What raw actions mean."""
        return self._formula.actions

    @property
    def is_checked(self) -> bool:
        """Whether what a policy plays may be another action than it proposes, a legal one."""
        return self._formula.is_checked

    def play(self, params: Params, state: Mapping[str, np.ndarray], step: int) -> dict[str, Any]:
        """What policies do, see `FeedbackFormula.play`."""
        return self._formula.play(params, state, step)

    def raw(self, actions: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The raw actions that play actions, per fluent [*shape, ...]."""
        formula, found = self._formula.actions, {}
        for name, action in actions.items():
            rest = (1,) * (np.ndim(action) - np.ndim(formula.noop[name]))
            noop = np.reshape(formula.noop[name], (*np.shape(formula.noop[name]), *rest))
            if name in formula.units:
                unit = np.reshape(formula.units[name], noop.shape)
                found[name] = (action - noop) / unit
            else:
                found[name] = (np.asarray(action, bool) ^ noop).astype(float)
        return found

    def returns(
        self, weights: Weights, vectors: np.ndarray, episodes: int, seed: Any
    ) -> np.ndarray:
        """The worth of episodes [P, N] of policies, all of them with the same random numbers.

        Args:
          weights: what the vectors stand for.
          vectors: [P, D].
          episodes: of each policy, N.
          seed: of the episodes.
        """
        at_once = max(1, self._simulator.block // episodes)
        parts = []
        for first in range(0, len(vectors), at_once):
            some = vectors[first : first + at_once]
            play = self._formula.replicas(weights.batch(some, episodes))
            count = len(some) * episodes
            found = worth(self._simulator, play, count, seed, self._check, len(some))
            parts.append(found.reshape(len(some), episodes))
        return np.concatenate(parts)
