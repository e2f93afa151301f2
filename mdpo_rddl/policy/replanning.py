"""A policy that plans anew at every decision."""

import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import numpy as np

from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.upstream import JaxOnlineController

_CALLS_IN_A_DECISION = 10


class Decision(NamedTuple):
    """How one decision was made.

    Attributes:
      episode, step: when, both from 0.
      iterations: gradient steps done.
      seconds: wall time, from the state to the action.
      best_return: smoothed test return of the plan acted on, over the lookahead.
      mean_sigma: the noise's scale at the last iteration, averaged over the lookahead.
    """

    episode: int
    step: int
    iterations: int
    seconds: float
    best_return: float
    mean_sigma: float


class OnlinePolicy:
    """Plays by replanning with JaxPlan's online controller, warm-started from step to step.

    Attributes:
      decisions: every decision so far.
    """

    def __init__(self, built: Built[MDPOPlanner], seed: int, budget: Budget | None = None) -> None:
        """Compiles nothing yet.

        Args:
          built: the planner.
          seed: of all decisions.
          budget: of each decision; as configured if None.
        """
        self._controller = JaxOnlineController(
            built.planner,
            key=jax.random.PRNGKey(seed),
            max_attempts=0,  # everything is compiled before the first decision
            **built.training_arguments(budget),
        )
        self.decisions: list[Decision] = []
        self._episode = -1

    def compile(self, state: Mapping[str, Any]) -> float:
        """Makes a cold and some warm decisions, and forgets them.

        The planner's calls become so short that a decision can keep to its time.

        Args:
          state: any state, as the environment shows it.

        Returns:
          The seconds that it took.
        """
        started = time.perf_counter()
        arguments = self._controller.train_kwargs
        self._controller.train_kwargs = {**arguments, "epochs": 2, "train_seconds": 1e9}
        planner = self._controller.planner
        with planner.call_sizes(1, 1):
            for _ in range(3):
                began = time.perf_counter()
                self._controller.sample_action(dict(state))
            seconds = (time.perf_counter() - began) / 2
        planner.bound_calls(arguments["train_seconds"] / _CALLS_IN_A_DECISION / seconds)
        self._controller.train_kwargs = arguments
        self._controller.reset()
        return time.perf_counter() - started

    def __call__(self, step: int, state: Mapping[str, Any]) -> Mapping[str, Any]:
        """The action for a state; step 0 begins a new episode."""
        if step == 0:
            self._episode += 1
            self._controller.reset()
        started = time.perf_counter()
        action = self._controller.sample_action(dict(state))
        seconds = time.perf_counter() - started
        callback = self._controller.callback
        sigma = float(np.mean(callback["sigma"]))
        best = float(callback["best_return"])
        iterations = callback["iteration"] + 1
        decision = Decision(self._episode, step, iterations, seconds, best, sigma)
        self.decisions.append(decision)
        return action
