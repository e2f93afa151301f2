"""The greedy policy of a value: one step of the exact model, and what it is worth to be there."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, random

from mdpo_rddl.planner.plans.effects import Effects
from mdpo_rddl.planner.plans.expectation import Expectation
from mdpo_rddl.planner.plans.feedback_plan import concurrency_limits, in_order
from mdpo_rddl.planner.plans.legal import LegalActions
from mdpo_rddl.planner.plans.limited_bools import Shift
from mdpo_rddl.planner.plans.limits import choose_within_limits
from mdpo_rddl.planner.plans.state_values import StateValues, ValueShape, Weights
from mdpo_rddl.planner.programs.dependence import dependence
from mdpo_rddl.planner.rollouts.plan_memory import NO_MEMORY, PlanMemory
from mdpo_rddl.planner.upstream import JaxPlan
from mdpo_rddl.problem.limits import GroupLimit, group_limits

Actions = dict[str, Array]
_TINY = 1e-30
# of what v reads, that one change affects: then it is worth while to compute the others once
_FEW_AFFECTED = 4


def can_be_greedy(rddl: Any) -> bool:
    """Whether there is such a policy: all actions are bools, and the state is observed.

    Args:
      rddl: pyRDDLGym's lifted model.
    """
    kinds = {rddl.variable_ranges[name] for name in rddl.action_fluents}
    return kinds == {"bool"} and not rddl.observ_fluents


class GreedyPlan(JaxPlan):
    """Leaves the no-op with each bool whose change alone gains, the best ones within the limits.

    The gain of a change d is estimated from s by one step of the exact model, with random numbers
    that are the same for all changes,

        g_d = r(s, d) + gamma v(s'_d) - r(s, no-op) - gamma v(s'_no-op),

    v being `StateValues` and what is usual at the step, and 0 after the end of an episode. Where
    the model states how likely a bool is in s', v reads that, which is exact for what is linear in
    it, a mean field for the rest. The model tells what an action does where a state's own features
    do not: a policy of these would need products of them. Joint gains are taken for the sums of
    single ones.

    The parameters are v's weights and the levels of the steps. The initial policy is greedy for the
    reward of one step.

    Attributes:
      exact: the exact model as JaxPlan compiles it; whoever compiles the plan sets it first.
      is_legal: its actions are: whoever plays it need not see to that.
      values: v, once the plan is compiled.
      size: number of bools D.
    """

    history_dependent = False
    squashes = False
    is_softmax = False
    is_legal = True
    units: Mapping[str, np.ndarray] = {}
    concurrency: Sequence[GroupLimit] = ()
    memory: PlanMemory = NO_MEMORY
    action_gradients: Callable[[Any], dict[str, Array]] | None = None

    def __init__(self, shape: ValueShape | None = None, samples: int = 1) -> None:
        """Describes the policy.

        Args:
          shape: what the value is made of; `ValueShape()` if None.
          samples: of the step of the model, for each change.

        Raises:
          ValueError: if there is no sample.
        """
        super().__init__()
        is_count = isinstance(samples, int) and not isinstance(samples, bool)
        if not (is_count and samples >= 1):
            raise ValueError(f"samples: must be a whole number of at least 1, got {samples!r}")
        self._shape, self._samples = shape or ValueShape(), samples
        self.exact: Any = None
        self.probabilities: Callable[..., Actions] = _not_compiled

    def compile(self, compiled: Any, _bounds: Any, horizon: int, preprocessor: Any = None) -> None:
        """Compiles the policy, as JaxPlan asks its plans to.

        Raises:
          ValueError: if there is a preprocessor, if an action is no bool, or if the state is not
            observed.
        """
        rddl, exact = compiled.rddl, self.exact
        if preprocessor is not None or not can_be_greedy(rddl):
            raise ValueError(
                "GreedyPlan needs actions that are bools and an observed state, "
                "and scales it itself: preprocessor must be None"
            )
        _, self.bounds, _, _ = self._calculate_action_info(compiled, _bounds, horizon)
        known = exact.init_values
        self._noop = {name: np.asarray(known[name]).astype(bool) for name in rddl.action_fluents}
        self.size = sum(math.prod(value.shape) for value in self._noop.values())
        self._fluents, self._nonfluents = exact.split_fluent_nonfluent(known)
        self._states, self._discount = list(rddl.state_fluents), float(rddl.discount)
        shapes = {name: value.shape for name, value in self._noop.items()}
        self._limits = group_limits(rddl)[0]
        # where a no-op is true, changing few is not having few true
        if not any(np.any(value) for value in self._noop.values()):
            self._limits += concurrency_limits(rddl, shapes)
        self._legal = LegalActions(exact, self._limits)
        self.values = StateValues(rddl, known, self._shape, horizon, exact.REAL)
        transition = exact.compile_transition(check_constraints=True, cache_path_info=False)
        model = exact.model_aux["params"]

        def after(key: Array, action: Actions, fluents: Any) -> tuple[Any, Array, Array]:
            found, log, _ = transition(key, action, fluents, self._nonfluents, model)
            return found, log["reward"], log["termination"] | ~log["invariant"]

        self._after = after
        self.__dict__.pop("_effects", None)  # of what was compiled before
        self._expectation = Expectation(exact)

        def policy(key, params, hyperparams, step, state, history):
            del hyperparams, history
            return self.choose(self.gains(params, key, state, step), state)

        def probabilities(key, params, hyperparams, step, state, history):
            del hyperparams, history
            return self._preferred(self.gains(params, key, state, step))[0]

        self.train_policy = self.test_policy = policy
        self.probabilities = probabilities
        self.projection = lambda params, hyperparams: (params, jnp.array(True))
        self.initializer = lambda key, hyperparams, state: self.values.with_levels(
            self.values.initial(key)
        )

    def gains(self, params: Weights, key: Array, state: Mapping[str, Array], step: Any) -> Array:
        """What each bool's change alone gains over the no-op [D].

        Args:
          params: weights of the value.
          key: of the samples.
          state: per state fluent [*shape].
          step: of the rollout, from 0.
        """
        fluents, keys = self._complete(state), random.split(key, self._samples)
        # the no-op, then a change each
        alone = jnp.eye(1 + self.size, self.size, -1, dtype=bool)

        def sample(key: Array) -> Array:
            after = jax.vmap(lambda leaving: self._step(key, leaving, fluents))
            inputs, rewards, ended = after(alone)
            effects = self._effects
            if effects is None:
                value = partial(self.values.value, params, step=step + 1)
                worth = jax.vmap(value)(inputs)
            else:
                # of the steps that are made alone nothing but the rewards is computed then
                none = np.zeros((1, self.size), bool)
                inputs = after(jnp.asarray(np.concatenate([none, effects.together])))[0]
                there = inputs[1 + effects.of_change[:, np.newaxis], effects.places]
                changes = jnp.where(effects.mask, there - inputs[0][effects.places], 0.0)
                given = params, inputs[0], effects.places, changes, step + 1
                noop = self.values.value(params, inputs[0], step + 1)
                worth = jnp.append(noop, self.values.changed(*given))
            # what is usual is the same for all that goes on
            level = self.values.level(params, step + 1)
            return rewards + self._discount * jnp.where(ended, -level, worth)

        totals = jnp.mean(jax.vmap(sample)(keys), axis=0)
        return totals[1:] - totals[0]

    @property
    def tried(self) -> int:
        """How many actions a decision tries for what they lead to."""
        return self.size if self._effects is None else len(self._effects.together)

    def _step(
        self, key: Array, leaving: Array, fluents: Mapping[str, Array]
    ) -> tuple[Array, Array, Array]:
        """What v reads after a step, the reward, and whether the episode is over."""
        found, reward, ended = self._after(key, self._left(leaving), fluents)
        following = {name: found[name] for name in self._states}
        before = {name: fluents[name] for name in self._states}
        following |= self._expectation({**found, **before})
        return self.values.inputs(following), reward, ended

    @cached_property
    def _effects(self) -> Effects | None:
        """What each change affects of what v reads; None if that is too much to tell apart."""
        # only their shapes count; no tracer of a program in the midst of which this is asked
        fluents = jax.eval_shape(self._complete, self.exact.init_values)
        key, leaving = jax.eval_shape(partial(random.PRNGKey, 0)), np.zeros(self.size, bool)
        program = jax.make_jaxpr(self._step)(key, leaving, fluents)
        own = np.eye(self.size, dtype=bool)
        starts = [None, own, *[None] * (len(program.jaxpr.invars) - 2)]
        effects = Effects.of(dependence(program, starts, self.size)[0])
        is_shorter = len(effects.together) < self.size
        is_sparse = _FEW_AFFECTED * effects.places.shape[1] <= self.values.size
        return effects if is_shorter or is_sparse else None

    def choose(self, gains: Array, state: Mapping[str, Array]) -> Actions:
        """A legal action of the changes that gain.

        Args:
          gains: of the changes [D], or what is in their order and has their signs.
          state: per state fluent [*shape].
        """
        true, left = self._preferred(gains)
        action = {name: left[name] ^ self._noop[name] for name in self._noop}
        grouped = {name for limit in self._limits for name in limit.groups}
        if grouped:
            action |= choose_within_limits({name: true[name] for name in grouped}, self._limits)
        return self._legal(action, true, state) if self._legal.is_needed else action

    def _preferred(self, gains: Array) -> tuple[Actions, Actions]:
        """Per bool a number in the order of what true gains, 0.5 for 0, and whether it changes."""
        leaving = in_order(gains / (jnp.max(jnp.abs(gains)) + _TINY))
        true, left = {}, self._tree(gains > 0.0)
        for name, value in self._tree(leaving).items():
            true[name] = jnp.where(self._noop[name], 1.0 - value, value)
        return true, left

    def _left(self, leaving: Array) -> Actions:
        return {name: left ^ self._noop[name] for name, left in self._tree(leaving).items()}

    def _tree(self, flat: Array) -> Actions:
        tree, start = {}, 0
        for name, noop in self._noop.items():
            end = start + math.prod(noop.shape)
            tree[name] = jnp.reshape(flat[start:end], noop.shape)
            start = end
        return tree

    def _complete(self, state: Mapping[str, Array]) -> dict[str, Array]:
        """All fluents, in the exact model's types: those of the state, and what is computed."""
        fluents = {name: jnp.asarray(value) for name, value in self._fluents.items()}
        for name in self._states:
            like = fluents[name]
            fluents[name] = jnp.reshape(jnp.asarray(state[name], like.dtype), like.shape)
        return fluents

    def guess_next_epoch(self, params: Weights) -> Weights:
        """The weights, which are a warm start as they are."""
        return params

    def shift_for(self, names: Sequence[str]) -> Shift:
        """Noise on the actions has no place in a choice: nothing is shifted."""
        del names
        return lambda params, hyperparams, step, perturbation: (params, step)


def _not_compiled(*_: Any) -> Any:
    raise RuntimeError("the plan is not compiled yet")
