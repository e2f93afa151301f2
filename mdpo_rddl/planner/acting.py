"""What a trained planner of JaxPlan's does: its actions, made legal in 64 bit."""

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from jax import Array, random

from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.start import initial_values, unit_hyperparams
from mdpo_rddl.planner.upstream import JaxBackpropPlanner


class ActingPlanner(JaxBackpropPlanner):
    """JaxPlan's planner with actions that an exact environment accepts."""

    def get_action(
        self,
        key: Array,
        params: Any,
        step: int,
        state: Mapping[str, Any],
        policy_hyperparams: Any = None,
        history: Any = None,
    ) -> dict[str, Any]:
        """JaxPlan's action, with reals clipped to the RDDL's box in 64 bit.

        A bound rounded to 32 bit can lie outside the box, which an environment with
        `enforce_action_constraints=True` refuses. Policy hyperparameters that are not given
        are 1, as in `optimize`.
        """
        hyperparams = self._complete_hyperparams(policy_hyperparams)
        actions = dict(super().get_action(key, params, step, state, hyperparams, history))
        for name, prange in self.rddl.action_ranges.items():
            if prange == "real" and name in actions:
                bounds = self.test_compiled.constraints.bounds[name]
                actions[name] = np.clip(np.asarray(actions[name], np.float64), *bounds)
        return actions

    def _complete_hyperparams(self, hyperparams: Any) -> Any:
        if hyperparams is not None and not isinstance(hyperparams, Mapping):
            return hyperparams
        complete = {**unit_hyperparams(self), **(hyperparams or {})}
        if self.preprocessor is not None and self.preprocessor.HYPERPARAMS_KEY not in complete:
            complete[self.preprocessor.HYPERPARAMS_KEY] = self.preprocessor.initialize()
        return complete

    @property
    def feedback_plan(self) -> FeedbackPlan:
        """The plan, where it is one of lifted feedback.

        Raises:
          TypeError: if the planner was made with another kind of plan.
        """
        if not isinstance(self.plan, FeedbackPlan):
            raise TypeError(f"the plan must be a FeedbackPlan, got {type(self.plan).__name__}")
        return self.plan

    def params_structure(self, policy_hyperparams: Mapping[str, Any]) -> Any:
        """Shapes and types of one policy's parameters, as a tree of `jax.ShapeDtypeStruct`."""
        fluents = initial_values(self).training.fluents
        key = random.PRNGKey(0)
        return jax.eval_shape(self.plan.initializer, key, dict(policy_hyperparams), fluents)
