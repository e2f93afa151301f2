"""What a policy returns from any state at any step, if other actions come first; compiled."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax, random

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.changes import Changes, choices
from mdpo_rddl.planner.plans.legal import LegalActions
from mdpo_rddl.planner.programs.quick import quick_jit
from mdpo_rddl.planner.programs.staging import Stages
from mdpo_rddl.planner.rollouts.plan_memory import Entries
from mdpo_rddl.planner.start import initial_values
from mdpo_rddl.problem.limits import group_limits

Actions = dict[str, Array]
_SHARED, _EARLY, _LATE = range(3)
# of a root's particles: in so many an action must be legal
_CHECKED = 64
# of a real's own size: what single precision makes of it in a few steps
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Size:
    """How much one call of the compiled program computes.

    Attributes:
      candidates: C, compared on the same scenarios.
      scenarios: N, streams of random numbers.
    """

    candidates: int
    scenarios: int

    @property
    def rollouts(self) -> int:
        """C * N."""
        return self.candidates * self.scenarios


class HiddenRoot(NamedTuple):
    """Where rollouts begin whose first state is not observed.

    Attributes:
      particles: of the state, all of the same weight, per state fluent [P, *shape].
      observed: what the policy reads at the first step, per observation fluent [*shape].
      memory: of the policy before the first step, per entry [*shape].
    """

    particles: Mapping[str, Any]
    observed: Mapping[str, Any]
    memory: Entries


class Continuations:
    """Rollouts on the exact model that begin in a given state at a given step.

    A candidate is an array [k, D] over an action's D components side by side, in the order of
    `changes`: the first row is the action that is played at once, the others change the policy's
    actions at the k - 1 steps after it. They are added to reals; a component with few values has
    the n-th of them where they are n, counted from 1, and the policy's where they are 0. Where
    that is illegal, the policy's own action is played. Then the policy plays to the horizon, never
    beyond. No reward counts after a termination condition or a broken invariant.
    """

    def __init__(self, planner: MDPOPlanner, policy: Callable[..., Actions] | None = None) -> None:
        """Reads the exact model.

        Args:
          planner: compiled for the problem.
          policy: what plays after the first actions; the planner's if None.
        """
        compiled = planner.test_compiled
        limits = [*group_limits(planner.rddl)[0], *getattr(planner.plan, "concurrency", [])]
        self.changes = Changes(compiled)
        self._planner, self._compiled = planner, compiled
        self._policy = planner.legal_policy if policy is None else policy
        self._legal = LegalActions(compiled, limits)
        fluents, self._nonfluents = initial_values(planner).test
        self._fluents = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), fluents)
        self._kinds = {name: planner.rddl.variable_ranges[name] for name in self.action_names}
        listed = {name: choices(compiled, name) for name in self._kinds}
        self._lowest = {name: values[0] for name, values in listed.items() if values}
        self._stopping = bool(planner.rddl.terminations or planner.rddl.invariants)

    @property
    def action_names(self) -> list[str]:
        """The action fluents, in the order of the components."""
        return list(self._planner.rddl.action_fluents)

    def compile_legality(self) -> Callable[[Mapping[str, Any] | HiddenRoot, Any], Array]:
        """Compiles which actions are legal.

        Returns:
          A function of a state, per state fluent [*shape], or of a `HiddenRoot`, and of actions
          [M, D] that gives whether each is legal [M], in all of some particles of a root.
        """

        def one(state: Mapping[str, Any], flat: Array) -> Array:
            return self._legal.is_legal(self._tree(flat), state)

        many = jax.vmap(one, in_axes=(None, 0))

        def legal(state: Any, actions: Array) -> Array:
            if not isinstance(state, HiddenRoot):
                return many(state, actions)
            some = {n: v[:: -(-len(v) // _CHECKED)] for n, v in state.particles.items()}
            return jnp.all(jax.vmap(many, in_axes=(0, None))(some, actions), axis=0)

        return jax.jit(legal)

    def compile(self, size: Size, is_rounded: bool = False) -> Callable[..., Array]:
        """Compiles the rollouts.

        Args:
          size: of one call.
          is_rounded: whether reals of the first state differ from scenario to scenario, by as
            little as rounding does. A return that hangs on it, as at the edge of a condition,
            another machine does not pay: environments compute in double precision.

        Returns:
          A function of a random key, the policy's parameters and hyperparameters, a state (per
          state fluent [*shape]; or a `HiddenRoot`), its step and candidates [C, k, D] that gives
          discounted returns [C, N], counted from that step on; all candidates see the same random
          numbers, and the same particles.
        """
        step = self._compile_step()
        horizon, discount = self._planner.rddl.horizon, float(self._planner.rddl.discount)
        model = self._compiled.model_aux["params"]

        def returns(key, params, hyperparams, state, start, candidates):
            shape = (size.candidates, size.scenarios)
            one, many = self._roots(key, state, shape)
            if is_rounded:
                many = self._rounded(random.fold_in(key, size.scenarios + 1), many), many[1]
            shared = (params, hyperparams, model)
            keys = random.split(key, size.scenarios)
            row = candidates[0, 0]
            stages = Stages(step, shared, (keys[0], start), (one, row, start))
            common = stages.run(_SHARED, [], shared)
            draw = jax.vmap(lambda *early: stages.run(_EARLY, [common], early), (0, None))
            late = jax.vmap(
                lambda drawn, *rest: stages.run(_LATE, [common, drawn], rest), (0, 0, None, None)
            )
            all_late = jax.vmap(late, (None, 0, 0, None))

            def goes_on(carry):
                number, _, alive, _, _ = carry
                return (number < horizon) & jnp.any(alive)

            def advance(carry):
                number, states, alive, total, weight = carry
                drawn = draw(jax.vmap(random.fold_in, (0, None))(keys, number), number)
                rows = _rows(candidates, number - start)
                states, reward, ended = all_late(drawn, states, rows, start)
                total = total + jnp.where(alive, weight * reward, 0.0)
                return number + 1, states, alive & ~ended, total, weight * discount

            real = self._compiled.REAL
            total = jnp.zeros(shape, real)
            carry = start, many, jnp.ones(shape, bool), total, jnp.ones((), real)
            return lax.while_loop(goes_on, advance, carry)[3]

        return quick_jit(returns)

    def _compile_step(self) -> Callable[..., tuple[Any, Array, Array]]:
        """One step of one rollout: what follows, the reward, and whether the episode is over."""
        transition = self._compiled.compile_transition(check_constraints=self._stopping)
        policy, update = self._policy, self._planner.memory.update

        def step(shared, early, late):
            params, hyperparams, model = shared
            key, number = early
            (fluents, memory), row, start = late
            key, model_key = random.split(key)
            actions = policy(key, params, hyperparams, number, fluents, memory)
            actions = self._overridden(actions, row, number == start, fluents)
            after, log, _ = transition(model_key, actions, fluents, self._nonfluents, model)
            after = {name: jnp.asarray(after[name], fluents[name].dtype) for name in fluents}
            memory = update(memory, number, fluents, actions)
            return (after, memory), log["reward"], log["termination"] | ~log["invariant"]

        return step

    def _roots(self, key: Array, state: Any, shape: tuple[int, int]) -> tuple[Any, Any]:
        """A fluent tree and a memory of one rollout, and those of all [C, N, ...]."""
        if not isinstance(state, HiddenRoot):
            one: Any = ({**self._fluents, **self._cast(state)}, {})
            return one, _broadcast(one, shape)
        common = {**self._fluents, **self._cast(state.observed)}, state.memory
        count = len(jax.tree.leaves(state.particles)[0])
        points = (jnp.arange(shape[1]) + random.uniform(random.fold_in(key, shape[1]))) / shape[1]
        # spread evenly: particles with the same past lie side by side
        places = jnp.minimum((points * count).astype(int), count - 1)
        drawn = {name: jnp.asarray(values)[places] for name, values in state.particles.items()}
        fluents, memory = _broadcast(common, shape)
        fluents |= {n: jnp.broadcast_to(v, (shape[0], *v.shape)) for n, v in drawn.items()}
        first = {name: values[0] for name, values in drawn.items()}
        return ({**common[0], **first}, common[1]), (fluents, memory)

    def _rounded(self, key: Array, many: tuple[Any, Any]) -> dict[str, Array]:
        """Fluents [C, N, *shape] whose reals differ a little from the state's, the first's not."""
        fluents, ranges = dict(many[0]), self._planner.rddl.variable_ranges
        for number, name in enumerate(self._planner.rddl.state_fluents):
            if ranges[name] == "real":
                value = fluents[name]
                own = random.fold_in(key, number)
                drawn = random.uniform(own, value.shape[1:], value.dtype, -1.0, 1.0)
                fluents[name] = value * (1.0 + _ROUNDING * drawn.at[0].set(0.0))
        return fluents

    def _overridden(self, actions: Any, row: Array, is_first: Array, state: Any) -> Actions:
        """The row's actions at the first step, the policy's as the row changes them at others."""
        first, numbers = self._tree(row), self.changes.numbers(row)
        later = {name: self._changed(name, actions[name], numbers[name]) for name in actions}
        if self._legal.is_needed:
            legal = self._legal.is_legal(later, state)
            later = {name: jnp.where(legal, later[name], actions[name]) for name in actions}
        return {
            name: jnp.where(is_first, first[name].astype(value.dtype), later[name])
            for name, value in actions.items()
        }

    def _changed(self, name: str, value: Array, numbers: Array) -> Array:
        """The policy's actions of a fluent [*shape], changed as a later row says."""
        if self._kinds[name] == "real":
            lower, upper = self._compiled.constraints.bounds[name]
            return jnp.clip(value + numbers, lower, upper).astype(value.dtype)
        if name not in self._lowest:
            return value
        given = (self._lowest[name] + numbers - 1.0).astype(value.dtype)
        return jnp.where(numbers > 0.0, given, value)

    def _tree(self, flat: Array) -> Actions:
        """A vector [D] as actions of the model's types."""
        return self.changes.tree(flat, {name: self._fluents[name] for name in self._kinds})

    def _cast(self, state: Mapping[str, Any]) -> dict[str, Array]:
        known = {name: self._fluents[name] for name in state}
        return {
            name: jnp.asarray(state[name], like.dtype).reshape(like.shape)
            for name, like in known.items()
        }


def _broadcast(tree: Any, shape: tuple[int, int]) -> Any:
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, shape + jnp.shape(leaf)), tree)


def _rows(candidates: Array, offset: Array) -> Array:
    """The candidates' rows for a step [C, D]; nothing is added after the last."""
    last = candidates.shape[1] - 1
    rows = candidates[:, jnp.minimum(offset, last)]
    return jnp.where(offset <= last, rows, 0.0)
