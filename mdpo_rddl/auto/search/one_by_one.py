"""Policies one after the other, where there is no time to compile what plays a population."""

import math

import jax
import numpy as np

from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.planner.exact.exact import exact_returns
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params

POLICIES = 8
"""Of a population that is played like that."""


class OneByOne:
    """Plays a population by the program of the judge, which is there.

    That takes longer than with a program of its own. Policies that the deadline leaves no time for
    return minus infinity.

    Attributes:
      seconds: of a population, by its latest policy; 0 before there is one.
      compile_seconds: what a program of its own would be likely to take.
    """

    def __init__(
        self,
        planner: MDPOPlanner,
        rollouts: int,
        compile_seconds: float,
        clock: Clock,
        deadline: float = math.inf,
    ) -> None:
        """Plays nothing yet.

        Args:
          planner: with a `FeedbackPlan`.
          rollouts: N of each policy, as many as the judge has.
          compile_seconds: see the class.
          clock: what times them.
          deadline: when to end, by the clock, but for the first policy of a population.
        """
        self._play, self._rollouts = exact_returns(planner, rollouts), rollouts
        self._clock, self._deadline = clock, deadline
        self.seconds, self.compile_seconds = 0.0, compile_seconds

    def __call__(self, key: jax.Array, params: Params) -> np.ndarray:
        """Returns [P, N] of policies whose parameters have a leading axis P."""
        count = len(jax.tree.leaves(params)[0])
        found = np.full((count, self._rollouts), -np.inf)
        for number in range(count):
            started = self._clock()
            if number and started + self.seconds / POLICIES > self._deadline:
                break
            one = jax.tree.map(lambda leaf, place=number: leaf[place : place + 1], params)
            found[number] = np.asarray(self._play(key, one), float)[0]
            self.seconds = POLICIES * (self._clock() - started)
        return found
