"""The greedy policy of a value: one step of the exact model, and what it is worth to be there."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax, random

from mdpo_rddl.planner.plans.effects import Effects
from mdpo_rddl.planner.plans.expectation import Expectation
from mdpo_rddl.planner.plans.feedback_actions import in_order
from mdpo_rddl.planner.plans.legal import LegalActions
from mdpo_rddl.planner.plans.limited_bools import Shift
from mdpo_rddl.planner.plans.limits import are_largest, choose_within_limits
from mdpo_rddl.planner.plans.single_changes import SingleChanges
from mdpo_rddl.planner.plans.state_values import StateValues, ValueShape, Weights
from mdpo_rddl.planner.programs.dependence import dependence
from mdpo_rddl.planner.rollouts.plan_memory import NO_MEMORY, PlanMemory
from mdpo_rddl.planner.upstream import JaxPlan
from mdpo_rddl.problem.chance import actions_weigh_chances
from mdpo_rddl.problem.limits import GroupLimit, concurrency_limits, group_limits

Actions = dict[str, Array]
_TINY = 1e-30
# of what v reads, that one change affects: then it is worth while to compute the others once
_FEW_AFFECTED = 4
# of a step of which not all that is drawn is read as probabilities; and of all that are tried
_MOST_SAMPLES, _MOST_STEPS = 64, 2048
# of a decision in rollouts, where chance says what an action leads to
_FEW_SAMPLES = 4


class GreedyPlan(JaxPlan):
    """Leaves the no-op with each component of the action whose change alone gains, to the value
    that gains most, the best ones within the limits.

    The gain of a change d is estimated from s by one step of the exact model, with random numbers
    that are the same for all changes,

        g_d = r(s, d) + gamma v(s'_d) - r(s, no-op) - gamma v(s'_no-op),

    v being `StateValues` and what is usual at the step, and 0 after the end of an episode. Where
    the model states how likely a bool is in s', v reads that, which is exact for what is linear in
    it, a mean field for the rest. The model tells what an action does where a state's own features
    do not: a policy of these would need products of them. Joint gains are taken for the sums of
    single ones; where some action is no bool, and `max-nondef-actions` allows all to change, the
    components are decided in turn instead, each beside what was decided before it.

    The parameters are v's weights and the levels of the steps. The initial policy is greedy for the
    reward of one step.

    Attributes:
      exact: the exact model as JaxPlan compiles it; whoever compiles the plan sets it first.
      is_legal: its actions are: whoever plays it need not see to that.
      rollout_policy: the policy with fewer samples, once the plan is compiled.
      values: v, once the plan is compiled.
      size: number of single changes D, of bools one each.
      is_in_turn: whether the components are decided in turn, once the plan is compiled.
    """

    history_dependent = False
    squashes = False
    is_softmax = False
    is_legal = True
    units: Mapping[str, np.ndarray] = {}
    concurrency: Sequence[GroupLimit] = ()
    memory: PlanMemory = NO_MEMORY
    action_gradients: Callable[[Any], dict[str, Array]] | None = None

    def __init__(self, shape: ValueShape | None = None, samples: int | None = None) -> None:
        """Describes the policy.

        Args:
          shape: what the value is made of; `ValueShape()` if None.
          samples: of the step of the model, for each change, as it is played; if None 1 where all
            that is drawn is read as probabilities, elsewhere 64, or fewer where many changes are
            tried.

        Raises:
          ValueError: if there is no sample.
        """
        super().__init__()
        is_count = isinstance(samples, int) and not isinstance(samples, bool)
        if samples is not None and not (is_count and samples >= 1):
            raise ValueError(f"samples: must be a whole number of at least 1, got {samples!r}")
        self._shape, self._samples = shape or ValueShape(), samples
        self.exact: Any = None
        self.probabilities: Callable[..., Actions] = _not_compiled
        self.rollout_policy: Callable[..., Actions] = _not_compiled

    def compile(self, compiled: Any, _bounds: Any, horizon: int, preprocessor: Any = None) -> None:
        """Compiles the policy, as JaxPlan asks its plans to.

        Raises:
          ValueError: if there is a preprocessor, if an action has many values, or if the state is
            not observed.
        """
        rddl, exact = compiled.rddl, self.exact
        changes = None if rddl.observ_fluents else SingleChanges.of(exact)
        if preprocessor is not None or changes is None:
            raise ValueError(
                "GreedyPlan needs actions of few values each and an observed state, "
                "and scales it itself: preprocessor must be None"
            )
        _, self.bounds, _, _ = self._calculate_action_info(compiled, _bounds, horizon)
        known = exact.init_values
        self.changes, self.size = changes, changes.size
        self._fluents, self._nonfluents = exact.split_fluent_nonfluent(known)
        self._states, self._discount = list(rddl.state_fluents), float(rddl.discount)
        shapes = {name: value.shape for name, value in changes.noop.items()}
        components = sum(value.size for value in changes.noop.values())
        self._limits, self._at_most = group_limits(rddl)[0], None
        if changes.numbers:
            few = rddl.max_allowed_actions < components
            self._at_most = max(1, int(rddl.max_allowed_actions)) if few else None
        # where a no-op is true, changing few is not having few true
        elif not any(np.any(value) for value in changes.noop.values()):
            self._limits += concurrency_limits(rddl, shapes)
        self.is_in_turn = bool(changes.numbers) and components > 1 and self._at_most is None
        self._legal = LegalActions(exact, self._limits)
        self.values = StateValues(rddl, known, self._shape, horizon, exact.REAL)
        transition = exact.compile_transition(check_constraints=True, cache_path_info=False)
        model = exact.model_aux["params"]

        def after(key: Array, action: Actions, fluents: Any) -> tuple[Any, Array, Array]:
            found, log, _ = transition(key, action, fluents, self._nonfluents, model)
            return found, log["reward"], log["termination"] | ~log["invariant"]

        self._after = after
        for name in ("_effects", "samples", "rollout_samples"):
            self.__dict__.pop(name, None)  # of what was compiled before
        self._expectation = Expectation(exact)

        def policy(key, params, hyperparams, step, state, history):
            del hyperparams, history
            return self.choose(self.gains(params, key, state, step), state)

        def rollout_policy(key, params, hyperparams, step, state, history):
            del hyperparams, history
            samples = self.rollout_samples
            return self.choose(self.gains(params, key, state, step, samples), state)

        def probabilities(key, params, hyperparams, step, state, history):
            del hyperparams, history
            return self._preferred(self.gains(params, key, state, step))[0]

        self.train_policy = self.test_policy = policy
        self.rollout_policy = rollout_policy
        self.probabilities = probabilities
        self.projection = lambda params, hyperparams: (params, jnp.array(True))
        self.initializer = lambda key, hyperparams, state: self.values.with_levels(
            self.values.initial(key)
        )

    def gains(
        self,
        params: Weights,
        key: Array,
        state: Mapping[str, Array],
        step: Any,
        samples: int | None = None,
    ) -> Array:
        """What each change gains over the no-op [D], alone or beside what is decided before it.

        Args:
          params: weights of the value.
          key: of the samples.
          state: per state fluent [*shape].
          step: of the rollout, from 0.
          samples: of the step of the model; the policy's if None.
        """
        fluents, keys = self._complete(state), random.split(key, samples or self.samples)
        if self.is_in_turn:
            return self._gains_in_turn(params, keys, fluents, step)
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
        return _known(totals[1:] - totals[0])

    def _gains_in_turn(self, params: Weights, keys: Array, fluents: Any, step: Any) -> Array:
        """Gains [D] of which each component's are over the best of what comes before it."""
        after = jax.vmap(lambda key, leaving: self._step(key, leaving, fluents), in_axes=(0, None))

        def total(leaving: Array) -> Array:
            inputs, rewards, ended = after(keys, leaving)
            worth = jax.vmap(lambda one: self.values.value(params, one, step + 1))(inputs)
            level = self.values.level(params, step + 1)
            return jnp.mean(rewards + self._discount * jnp.where(ended, -level, worth))

        def decide(carried: tuple[Array, Array], places: Array) -> tuple[Any, Array]:
            leaving, so_far = carried
            changes = jax.nn.one_hot(places, self.size, dtype=bool)
            gains = _known(jax.vmap(total)(leaving | changes) - so_far)
            best = jnp.argmax(gains)
            gained = jnp.maximum(gains[best], 0.0)
            leaving |= changes[best] & (gains[best] > 0.0)
            return (leaving, so_far + gained), gains

        none = jnp.zeros(self.size, bool)
        places = self.changes.places
        _, gains = lax.scan(decide, (none, total(none)), jnp.asarray(places))
        return jnp.zeros(self.size, gains.dtype).at[places].set(gains, mode="drop")

    @cached_property
    def samples(self) -> int:
        """Of the step of the model, for each action that the policy tries; once it is compiled."""
        if self._samples is not None:
            return self._samples
        if self._expectation.is_whole:
            return 1
        return max(1, min(_MOST_SAMPLES, _MOST_STEPS // self.tried))

    @cached_property
    def rollout_samples(self) -> int:
        """Of the step of the model in rollouts, where samples are rollouts that are not played.

        One tells what is better, as it is the same for all actions, unless these change how likely
        something is.
        """
        few = _FEW_SAMPLES if actions_weigh_chances(self.exact.rddl) else 1
        return min(few, self.samples)

    @property
    def tried(self) -> int:
        """How many actions a decision tries for what they lead to."""
        if self.is_in_turn:
            return self.changes.places.size
        return self.size if self._effects is None else len(self._effects.together)

    def _step(
        self, key: Array, leaving: Array, fluents: Mapping[str, Array]
    ) -> tuple[Array, Array, Array]:
        """What v reads after a step, the reward, and whether the episode is over."""
        found, reward, ended = self._after(key, self.changes.made(leaving), fluents)
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
        true, action = self._preferred(gains)
        grouped = {name for limit in self._limits for name in limit.groups}
        if grouped:
            action |= choose_within_limits({name: true[name] for name in grouped}, self._limits)
        return self._legal(action, true, state) if self._legal.is_needed else action

    def _preferred(self, gains: Array) -> tuple[Actions, Actions]:
        """Per bool a number in the order of what true gains, 0.5 for 0, and the changes that gain.

        Of numbers and objects no more than `max-nondef-actions` allows are changed; bools have
        their limits afterwards.
        """
        most, values = self.changes.best(gains)
        if self._at_most is not None:
            most = self._with_few(most, self._at_most)
        largest, true, action = jnp.max(jnp.abs(gains)) + _TINY, {}, {}
        for name, noop in self.changes.noop.items():
            action[name] = jnp.where(most[name] > 0.0, values[name], noop)
            if name not in self.changes.numbers:
                leaving = in_order(most[name] / largest)
                true[name] = jnp.where(noop, 1.0 - leaving, leaving)
        return true, action

    def _with_few(self, most: Actions, count: int) -> Actions:
        """What each component gains, so many at most not below 0."""
        ranked = jnp.concatenate([jnp.ravel(each) for each in most.values()])
        kept = are_largest(ranked, np.zeros(len(ranked), int), np.array([count]))
        few, start = {}, 0
        for name, each in most.items():
            end = start + each.size
            few[name] = jnp.where(jnp.reshape(kept[start:end], each.shape), each, -1.0)
            start = end
        return few

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


def _known(gains: Array) -> Array:
    """Gains, of which those that are not a number are none: they must not hide the others."""
    return jnp.where(jnp.isnan(gains), 0.0, gains)


def _not_compiled(*_: Any) -> Any:
    raise RuntimeError("the plan is not compiled yet")
