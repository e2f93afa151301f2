"""Gradient steps on an action and on what is added to the policy's actions after it; compiled."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax, random

from mdpo_rddl.noise import ActionNoise
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.programs.quick import quick_jit
from mdpo_rddl.planner.programs.staging import Stages
from mdpo_rddl.planner.rollouts.memory import bounded_scan
from mdpo_rddl.planner.start import initial_values

Actions = dict[str, Array]
_SHARED, _EARLY, _LATE = range(3)
# Adam's
_FIRST, _SECOND, _SMALL = 0.9, 0.99, 1e-12


class Ascent(NamedTuple):
    """How far candidates have climbed, to go on from.

    Attributes:
      candidates: [C, k, D].
      first, second: Adam's moments of the gradient [C, k, D].
      steps: how many there were [C].
    """

    candidates: Any
    first: Any
    second: Any
    steps: Any

    @classmethod
    def from_candidates(cls, candidates: np.ndarray) -> "Ascent":
        """Before the first step."""
        zeros = np.zeros_like(candidates)
        return cls(candidates, zeros, zeros, np.zeros(len(candidates), np.int32))

    def changed(self, change: Callable[[np.ndarray], np.ndarray]) -> "Ascent":
        """The candidates and the moments changed in the same way."""
        first, second = change(self.first), change(self.second)
        return Ascent(change(self.candidates), first, second, self.steps)


@dataclass(frozen=True)
class ClimbSize:
    """How much one gradient step computes.

    Attributes:
      candidates: C, each climbs by itself.
      scenarios: N, over whose mean return it climbs.
      window: W, at most so many steps from the state on count.
    """

    candidates: int
    scenarios: int
    window: int


class Climbing:
    """Climbs the return of the relaxed model from a given state at a given step.

    Candidates are as in `mdpo_rddl.planner.exact.continuations`: an action, then additions to the
    policy's real actions. Only real components move, and later changes of others are left out. The
    policy's own answer to other states is held fixed in the gradient, which through many steps of
    it would grow without bound.
    """

    def __init__(self, planner: MDPOPlanner) -> None:
        """Reads the relaxed model.

        Args:
          planner: whose policy plays after the first action.
        """
        self._planner, self._compiled = planner, planner.compiled
        fluents, self._nonfluents = initial_values(planner).training
        self._fluents = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), fluents)
        ranges = planner.rddl.variable_ranges
        self._kinds = {name: ranges[name] for name in planner.rddl.action_fluents}
        self._stopping = bool(planner.rddl.terminations or planner.rddl.invariants)

    def compile(
        self, size: ClimbSize, units: np.ndarray, noise: ActionNoise
    ) -> Callable[..., tuple[Ascent, Array]]:
        """Compiles steps of Adam.

        Args:
          size: of one step.
          units: what a step of 1 means per component, 0 where it does not move [D].
          noise: a rule that asks for the gradient of the actions alone.

        Returns:
          A function of a random key, the policy's parameters and hyperparameters (a pair), a state
          (per state fluent [*shape]) and its step (a pair), an `Ascent`, rates [C, k] and how
          many more steps of Adam. It gives the ascent after them and, per step of the candidates
          that were given, the noise's sigma in units [C, k].
        """
        returns = self._compile_returns(size)
        ascend = jax.vmap(jax.grad(returns), in_axes=(0, None))
        scale = jnp.asarray(units, self._compiled.REAL)

        def sigma(gradient, start):
            last = jnp.minimum(self._planner.rddl.horizon - start, size.window)
            left = jnp.arange(len(gradient)) < last
            # steps without a gradient do not count
            known = jnp.where(left[:, jnp.newaxis], gradient, jnp.nan)
            return noise.profile({"actions": known}, (), len(gradient))[0].sigma

        def climb(key, policy, place, ascent, rates, steps):
            state, start = place
            given = key, policy, self._cast(state), start
            rates = rates[:, :, jnp.newaxis]

            def advance(number, carry):
                ascent, initial = carry
                gradient = ascend(ascent.candidates, given) * scale
                gradient = jnp.where(jnp.isfinite(gradient), gradient, 0.0)
                first = _FIRST * ascent.first + (1.0 - _FIRST) * gradient
                second = _SECOND * ascent.second + (1.0 - _SECOND) * gradient**2
                count = ascent.steps + 1
                power = count[:, jnp.newaxis, jnp.newaxis]
                mean = first / (1.0 - _FIRST**power)
                size = jnp.sqrt(second / (1.0 - _SECOND**power))
                moved = ascent.candidates + rates * scale * mean / (size + _SMALL)
                after = Ascent(self._with_legal_start(moved), first, second, count)
                return after, jnp.where(number == 0, gradient, initial)

            carry = ascent, jnp.zeros_like(ascent.candidates)
            ascent, initial = lax.fori_loop(0, steps, advance, carry)
            return ascent, jax.vmap(sigma, (0, None))(initial, start)

        return quick_jit(climb)

    def _with_legal_start(self, candidates: Array) -> Array:
        """The candidates with the first action's real components in their box."""
        lower, upper = self._boxes()
        return candidates.at[:, 0].set(jnp.clip(candidates[:, 0], lower, upper))

    def _boxes(self) -> tuple[Array, Array]:
        ends = []
        for end, unbounded in enumerate((-np.inf, np.inf)):
            parts = [
                np.ravel(self._bounds(name)[end])
                if kind == "real"
                else np.full(max(1, self._fluents[name].size), unbounded)
                for name, kind in self._kinds.items()
            ]
            ends.append(jnp.asarray(np.concatenate(parts), self._compiled.REAL))
        return ends[0], ends[1]

    def _bounds(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        shape = np.shape(self._fluents[name])
        lower, upper = self._planner.test_compiled.constraints.bounds[name]
        return np.broadcast_to(lower, shape), np.broadcast_to(upper, shape)

    def _compile_returns(self, size: ClimbSize) -> Callable[[Array, Any], Array]:
        """The mean return of one candidate [k, D]."""
        step = self._compile_step()
        horizon, discount = self._planner.rddl.horizon, float(self._planner.rddl.discount)
        model = self._compiled.model_aux["params"]

        def returns(candidate, given):
            key, (params, hyperparams), fluents, start = given
            shared = (params, hyperparams, self._nonfluents, model)
            keys = random.split(key, size.scenarios)
            late = (fluents, candidate[0], jnp.array(True))
            stages = Stages(step, shared, (keys[0], start), late)
            common = stages.run(_SHARED, [], shared)
            draw = jax.vmap(lambda *early: stages.run(_EARLY, [common], early), (0, None))
            play = jax.vmap(
                lambda drawn, *rest: stages.run(_LATE, [common, drawn], rest), (0, 0, None, None)
            )

            def advance(carry, inputs):
                fluents, alive, weight = carry
                offset, row = inputs
                number = start + offset
                drawn = draw(jax.vmap(random.fold_in, (0, None))(keys, number), number)
                fluents, reward, ended = play(drawn, fluents, row, offset == 0)
                counts = alive & (number < horizon)
                # what is not finite must not survive a multiplication by zero
                reward = jnp.where(counts, weight * reward, 0.0)
                return (fluents, counts & ~ended, weight * discount), reward

            many = jax.tree.map(
                lambda leaf: jnp.broadcast_to(leaf, (size.scenarios, *leaf.shape)), fluents
            )
            carry = many, jnp.ones(size.scenarios, bool), jnp.ones((), self._compiled.REAL)
            missing = max(0, size.window - len(candidate))
            rows = jnp.pad(candidate, ((0, missing), (0, 0)))[: size.window]
            inputs = jnp.arange(size.window), rows
            rewards = bounded_scan(advance, carry, inputs, size.candidates)[1]
            return jnp.sum(rewards) / size.scenarios

        return returns

    def _compile_step(self) -> Callable[..., tuple[Any, Array, Array]]:
        transition = self._compiled.compile_transition(check_constraints=self._stopping)
        policy = self._planner.plan.train_policy

        def step(shared, early, late):
            params, hyperparams, nonfluents, model = shared
            key, number = early
            fluents, row, is_first = late
            key, model_key = random.split(key)
            actions = lax.stop_gradient(policy(key, params, hyperparams, number, fluents, {}))
            actions = self._changed(actions, row, is_first)
            after, log, _ = transition(model_key, actions, fluents, nonfluents, model)
            after = {name: jnp.asarray(after[name], fluents[name].dtype) for name in fluents}
            ended = log["termination"] | ~log["invariant"] if self._stopping else jnp.array(False)
            return after, log["reward"], ended

        return step

    def _changed(self, actions: Actions, row: Array, is_first: Array) -> Actions:
        """The row's actions at the first step, later the policy's and the row's."""
        shapes = [np.shape(self._fluents[name]) for name in self._kinds]
        ends = np.cumsum([math.prod(shape) for shape in shapes]).tolist()[:-1]
        parts = zip(self._kinds, jnp.split(row, ends), shapes, strict=True)
        given = {name: part.reshape(shape) for name, part, shape in parts}
        chosen: Actions = {}
        for name, value in actions.items():
            if self._kinds[name] == "real":
                raw = jnp.where(is_first, 0.0, value) + given[name]
                lower, upper = self._bounds(name)
                clipped = jnp.clip(raw, lower, upper)
                # what the box cuts off keeps its gradient, else it would never come back
                chosen[name] = (raw + lax.stop_gradient(clipped - raw)).astype(value.dtype)
            else:
                chosen[name] = jnp.where(is_first, given[name].astype(value.dtype), value)
        return chosen

    def _cast(self, state: Mapping[str, Any]) -> dict[str, Array]:
        known = {
            name: jnp.asarray(value, self._fluents[name].dtype).reshape(self._fluents[name].shape)
            for name, value in state.items()
        }
        return {**self._fluents, **known}
