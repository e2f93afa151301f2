"""The feedback policy as a plan that JaxPlan can train."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.planner.plans.feedback import Feedback, Params
from mdpo_rddl.planner.plans.feedback_actions import (
    BOOL_SCALE,
    FeedbackActions,
    in_order,
    sigmoid,
)
from mdpo_rddl.planner.plans.feedback_shape import FeedbackShape
from mdpo_rddl.planner.plans.limited_bools import Shift
from mdpo_rddl.planner.plans.limits import scale_to_limits
from mdpo_rddl.planner.rollouts.plan_memory import NO_MEMORY, Entries, PlanMemory
from mdpo_rddl.planner.upstream import JaxPlan
from mdpo_rddl.problem.limits import GroupLimit


class FeedbackPlan(JaxPlan):
    """Plays what `FeedbackActions` makes of the raw actions of `Feedback`.

    The initial policy plays the no-op.
    """

    history_dependent = False

    # JaxPlan's own choices, which this plan does not have
    squashes = False
    is_softmax = False
    is_legal = False

    def __init__(
        self, shape: FeedbackShape | None = None, units: Mapping[str, float] | None = None
    ) -> None:
        """Describes the policy.

        Args:
          shape: what the policy is made of; `FeedbackShape()` if None.
          units: per real or integer action fluent what a raw value of 1 means; the width of
            its box where it is not named, 1 if it has none.
        """
        super().__init__()
        self._shape = shape or FeedbackShape()
        self._given_units = dict(units or {})
        self.units: dict[str, np.ndarray] = {}
        self._actions: FeedbackActions | None = None
        # at most so many bools that are not at their default, all fluents together
        self.concurrency: list[GroupLimit] = []
        self.probabilities: Callable[..., dict[str, Array]] = _not_compiled
        # between 0 and 1 as these, in the order of the log-odds: for whoever ranks proposals
        self.preferences: Callable[..., dict[str, Array]] = _not_compiled
        # the policies' last argument has its entries
        self.memory: PlanMemory = NO_MEMORY
        # the parameters' gradient -> that of the raw actions [..., H, *shape], as noise meets them
        self.action_gradients: Callable[[Params], dict[str, Array]] | None = None

    @property
    def feedback(self) -> Feedback:
        """The policy's raw actions.

        Raises:
          RuntimeError: before the plan is compiled.
        """
        return self.actions.feedback

    @property
    def actions(self) -> FeedbackActions:
        """What the policy plays of them, before anything is made legal.

        Raises:
          RuntimeError: before the plan is compiled.
        """
        return _not_compiled() if self._actions is None else self._actions

    def compile(self, compiled: Any, _bounds: Any, horizon: int, preprocessor: Any = None) -> None:
        """Compiles the policy, as JaxPlan asks its plans to.

        Raises:
          ValueError: if there is a preprocessor: the policy scales the states itself; or for a
            unit or scale of a fluent that is none, or a unit that is not above 0.
        """
        if preprocessor is not None:
            raise ValueError("FeedbackPlan scales the states itself: preprocessor must be None")
        self._check_names(compiled.rddl)
        _, self.bounds, _, _ = self._calculate_action_info(compiled, _bounds, horizon)
        values = compiled.init_values
        feedback = Feedback(compiled.rddl, values, self._shape, horizon, compiled.REAL, jnp)
        kinds = compiled.REAL, compiled.INT
        actions = self._actions = FeedbackActions.of(
            feedback, compiled.rddl, values, self._given_units, self.bounds, kinds
        )
        bools, limits, self.units = actions.bools, actions.limits, dict(actions.units)
        if not any(np.any(actions.noop[name]) for limit in limits for name in limit.groups):
            self.concurrency = list(limits)
        memory = self.memory = self._compile_memory()

        def seen(state: Mapping[str, Array], entries: Entries) -> dict[str, Array]:
            # who knows no memory, as JaxPlan's own controllers, gives none
            return {**state, **(entries or memory.initial)}

        def probabilities(key, params, hyperparams, step, state, history):
            del key, hyperparams
            return actions.probabilities(params, seen(state, history), step, sigmoid)

        def preferences(key, params, hyperparams, step, state, history):
            del key, hyperparams
            return actions.probabilities(params, seen(state, history), step, in_order)

        def train_policy(key, params, hyperparams, step, state, history):
            del key, hyperparams
            relaxed = actions.relaxed(params, seen(state, history), step, sigmoid)
            return actions.flipped(scale_to_limits(relaxed, limits))

        def test_policy(key, params, hyperparams, step, state, history):
            del key, hyperparams
            return actions.played(params, seen(state, history), step)

        self.train_policy, self.test_policy = train_policy, test_policy
        self.probabilities, self.preferences = probabilities, preferences
        self.projection = lambda params, hyperparams: (params, jnp.array(True))
        if self._shape.plan:
            self.action_gradients = lambda gradient: {
                name: value / BOOL_SCALE if name in bools else value
                for name, value in gradient["plan"].items()
            }
        self.initializer = lambda key, hyperparams, state: feedback.initial(key)

    def noop(self, seed: int) -> Params:
        """Parameters that play the no-op, drawn by numpy: nothing is compiled for them.

        Their hidden units are others than those of the initializer with the same seed.

        Args:
          seed: of the hidden units.

        Raises:
          RuntimeError: before the plan is compiled.
        """
        return self.feedback.initial(np.random.default_rng(seed))

    def proposed(self, params: Params, state: Mapping[str, Array], step: Any) -> dict[str, Array]:
        """Numbers in their box, not rounded, and of bools the log-odds of not being at the no-op.

        Args:
          params: of the policy.
          state: per state fluent [*shape].
          step: of the rollout, from 0.

        Raises:
          RuntimeError: before the plan is compiled.
        """
        return self.actions.relaxed(
            params, {**state, **self.memory.initial}, step, squash=lambda log_odds: log_odds
        )

    def _compile_memory(self) -> PlanMemory:
        """The policy's memory, told of actions as they are played."""
        initial = self.feedback.empty_memory()
        return PlanMemory(initial, self.actions.remembered) if initial else NO_MEMORY

    def guess_next_epoch(self, params: Params) -> Params:
        """A policy of the state is a warm start as it is; a plan has one step less to go."""
        if "plan" not in params:
            return params
        rest = jax.tree.map(lambda p: jnp.concatenate([p[1:], p[-1:]]), params["plan"])
        return {**params, "plan": rest}

    def shift_for(self, names: Sequence[str]) -> Shift:
        """How to shift the log-odds of some bools."""
        return lambda params, _, step, shifts: (self.shift_log_odds(params, shifts, names), step)

    def shift_log_odds(
        self, params: Params, shifts: Mapping[str, Array], names: Sequence[str]
    ) -> Params:
        """Parameters whose policy has the bools' log-odds shifted, per fluent [*shape]."""
        own = dict(params["own"])
        for name in names:
            bias = own[name]["bias"] + shifts[name] / BOOL_SCALE
            own[name] = {**own[name], "bias": bias}
        return {**params, "own": own}

    def _check_names(self, rddl: Any) -> None:
        given = {"units": self._given_units, "state_scales": self._shape.state_scales or {}}
        read = {*rddl.variable_params, *self._shape.lookups}
        known = {"units": set(rddl.action_fluents), "state_scales": read}
        for key, values in given.items():
            for name in values:
                if name not in known[key]:
                    kind = "action fluent" if key == "units" else "fluent"
                    raise ValueError(f"{key}: there is no {kind} {name!r}")
        for name, unit in self._given_units.items():
            if not np.all(np.asarray(unit) > 0.0):
                raise ValueError(f"units: that of {name} must be above 0, got {unit!r}")


def _not_compiled(*_: Any) -> Any:
    raise RuntimeError("the plan is not compiled yet")
