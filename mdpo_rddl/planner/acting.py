"""What a trained planner of JaxPlan's does: its actions, made legal in 64 bit."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, random

from mdpo_rddl.machine.device import chosen_device, computing_on
from mdpo_rddl.planner.compiled_models import CompilingPlanner
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.greedy_plan import GreedyPlan
from mdpo_rddl.planner.plans.opened import open_plan
from mdpo_rddl.planner.programs.quick import Jit, quick_jit
from mdpo_rddl.planner.rollouts.plan_memory import Entries, PlanMemory
from mdpo_rddl.planner.start import initial_values, unit_hyperparams
from mdpo_rddl.problem.observation import as_numbers

try:
    from jax import enable_x64
except ImportError:  # jax 0.6, which tensorflow-probability needs
    from jax.experimental import enable_x64  # type: ignore[attr-defined,no-redef]


class ActingPlanner(CompilingPlanner):
    """JaxPlan's planner with actions that an exact environment accepts."""

    def get_action(
        self,
        key: Array | np.ndarray,
        params: Any,
        step: int,
        state: Mapping[str, Any],
        policy_hyperparams: Any = None,
        history: Any = None,
    ) -> dict[str, Any]:
        """JaxPlan's action, with reals clipped to the RDDL's box in 64 bit.

        A bound rounded to 32 bit can lie outside the box, which an environment with
        `enforce_action_constraints=True` refuses. Policy hyperparameters that are not given
        are 1, as in `optimize`. A policy that remembers takes its memory as the history; without
        one it remembers nothing.
        """
        hyperparams = self._complete_hyperparams(policy_hyperparams)
        with self.computing():
            actions = super().get_action(key, params, step, state, hyperparams, history)
        return self.clipped(actions)

    def get_actions(
        self,
        key: Array | np.ndarray,
        params: Any,
        step: int,
        states: Mapping[str, Any],
        policy_hyperparams: Any = None,
        memories: Entries | None = None,
    ) -> dict[str, Any]:
        """`get_action` for many states in one call.

        Args:
          key: JAX random key for all of them [2], or one for each [batch, 2].
          params: parameters of one policy.
          step: number of decisions before.
          states: per fluent its values [batch, *shape]: numbers, bools or objects' names.
          policy_hyperparams: as `get_action` takes them.
          memories: of a policy that remembers, per entry [batch, *shape].

        Returns:
          Per action fluent [batch, *shape].
        """
        hyperparams = self._complete_hyperparams(policy_hyperparams)
        numbers = {name: self.numbers(name, values) for name, values in states.items()}
        with self.computing():
            given = key, params, hyperparams, step, numbers, memories or {}
            actions = self._batched_policies[np.ndim(key) > 1](*given)
        return self.clipped({name: np.asarray(values) for name, values in actions.items()})

    @cached_property
    def _batched_policies(self) -> list[Callable[..., Mapping[str, Array]]]:
        """With one key for all states, and with one for each."""
        given = None, None, None, 0, 0
        axes = (None, *given), (0, *given)
        return [self.acting_jit(jax.vmap(self.test_policy, in_axes=each)) for each in axes]

    @property
    def acting_jit(self) -> Jit:
        """What compiles the policy as it is played.

        That of `GreedyPlan` is a large program, whose compilation takes longer than its calls;
        JaxPlan's plans act as JaxPlan has them, to the bit.
        """
        return quick_jit if isinstance(self.plan, GreedyPlan) else jax.jit

    @property
    def memory(self) -> PlanMemory:
        """What the policy remembers."""
        return open_plan(self.plan).memory

    def remember(
        self,
        memories: Entries,
        step: int,
        states: Mapping[str, Any],
        actions: Mapping[str, Any],
    ) -> Entries:
        """The memories of some episodes after a step.

        Args:
          memories: before it, per entry [batch, *shape].
          step: number of decisions before.
          states: per fluent its values [batch, *shape], as the environment shows them.
          actions: per action fluent [batch, *shape].
        """
        numbers = {name: self.numbers(name, values) for name, values in states.items()}
        with self.computing():
            return self._batched_update(memories, step, numbers, dict(actions))

    @cached_property
    def _batched_update(self) -> Callable[..., Entries]:
        return jax.jit(jax.vmap(self.memory.update, in_axes=(0, None, 0, 0)))

    def numbers(self, name: str, values: Any) -> np.ndarray:
        """`as_numbers` of the planner's problem."""
        return as_numbers(self.rddl, name, values)

    def _jax_compile_rddl(self) -> None:
        self._device = chosen_device()
        super()._jax_compile_rddl()

    @contextmanager
    def computing(self) -> Iterator[None]:
        """JAX's device and precision as the planner was compiled, whatever they are by now."""
        with computing_on(self._device), enable_x64(jnp.float64 == self.compiled.REAL):
            yield

    def clipped(self, found: Mapping[str, Any]) -> dict[str, Any]:
        """Actions with reals in 64 bit within the RDDL's box, per action fluent [..., *shape].

        What is no number is the default: the environment would play it.
        """
        actions = dict(found)
        for name, prange in self.rddl.action_ranges.items():
            if prange == "real" and name in actions:
                bounds = self.test_compiled.constraints.bounds[name]
                values = np.asarray(actions[name], np.float64)
                values = np.where(np.isnan(values), self.test_compiled.init_values[name], values)
                actions[name] = np.clip(values, *bounds)
        return actions

    def _complete_hyperparams(self, hyperparams: Any) -> Any:
        if hyperparams is not None and not isinstance(hyperparams, Mapping):
            return hyperparams
        return {**unit_hyperparams(self), **(hyperparams or {})}

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
        hyperparams = self._complete_hyperparams(policy_hyperparams)
        return jax.eval_shape(self.plan.initializer, key, hyperparams, fluents)
