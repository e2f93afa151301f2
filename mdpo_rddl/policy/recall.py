"""The memory of a policy while it plays: of one episode, or of several side by side."""

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.opened import open_plan
from mdpo_rddl.planner.rollouts.plan_memory import Entries, initial_memories
from mdpo_rddl.policy.formula import require_count
from mdpo_rddl.problem.observation import is_observed


class Recall:
    """Follows episodes that are played step by step, all at the same one.

    The memory is empty at step 0, and at a step that does not follow the last. A step that is
    asked for again is the same decision again.
    """

    def __init__(self, planner: MDPOPlanner) -> None:
        """Remembers nothing yet.

        Args:
          planner: whose policy is played; it need not have a memory.
        """
        self._planner, self._memory = planner, open_plan(planner.plan).memory
        self.reset()

    def reset(self) -> None:
        """Forgets the episodes."""
        self._step = -1
        self._before: Entries = {}
        self._after: Entries = {}

    def at(self, step: int, count: int) -> Entries:
        """The memories before a step's decision, per entry [count, *shape].

        Args:
          step: number of decisions before.
          count: of the episodes.

        Raises:
          InputError: if the step follows the last one, which was of another number of episodes.
        """
        if not self._memory.initial:
            return {}
        if step > 0 and step == self._step + 1:
            self._before = self._after
        elif step == 0 or step != self._step:
            self._before = self._after = initial_memories(self._memory, count)
        known = len(jax.tree.leaves(self._before)[0])
        require_count(known, count, step)
        self._step = step
        return self._before

    def note(self, observations: Mapping[str, Any], actions: Mapping[str, Any]) -> None:
        """Takes in what was seen and played at the step that was asked for last.

        Args:
          observations: per fluent [count, *shape].
          actions: per action fluent [count, *shape].
        """
        if self._before:
            step = self._step
            self._after = self._planner.remember(self._before, step, observations, actions)

    def shown(self, step: int, observations: Mapping[str, Any], count: int) -> dict[str, Any]:
        """What is seen of several episodes, with initial values for what is shown from step 1 on.

        Args:
          step: number of decisions before.
          observations: per fluent [count, *shape].
          count: of the episodes.
        """
        initial = self._planner.test_compiled.init_values
        hidden = self._planner.rddl.observ_fluents if step == 0 else {}
        return {
            name: np.repeat(np.asarray(initial[name])[np.newaxis], count, axis=0)
            if name in hidden and not is_observed(values)
            else values
            for name, values in observations.items()
        }
