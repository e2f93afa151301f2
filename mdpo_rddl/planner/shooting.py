"""Direct single shooting: the actions of each step follow the gradient of the return; compiled.

Many straight-line plans climb side by side, each with its own step size, on one scenario: that is
for problems in whose return chance plays no part.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import Array, lax, random

from mdpo_rddl.planner.exact.exact import compile_exact_returns
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.rollouts.compiled import RolloutOptions, compile_rollouts
from mdpo_rddl.planner.rollouts.termination import stop_at_termination
from mdpo_rddl.planner.start import initial_values, repeated, unit_hyperparams

Plans = dict[str, Any]
"""Per action fluent the actions of L plans [L, H, *shape]."""

# of which the step size is left to each plan
_ADAM = optax.scale_by_adam(b1=0.9, b2=0.95, eps=1e-12)
# steps to one test of the plans on the exact model
_STEPS = 20


class Climb(NamedTuple):
    """How far plans have climbed.

    Attributes:
      plans: the latest ones.
      moments: of Adam.
      best: the best tested iterate of each.
      returns: what these return on the exact model [L].
    """

    plans: Plans
    moments: Any
    best: Plans
    returns: Any


class Shooting:
    """Climbs the return of the relaxed model, and tests on the exact one.

    Attributes:
      steps: of Adam between two tests.
    """

    steps = _STEPS

    def __init__(self, planner: MDPOPlanner, units: Mapping[str, np.ndarray]) -> None:
        """Compiles nothing yet.

        Args:
          planner: of straight-line plans, all of whose actions are real.
          units: what a step of 1 means, per action fluent a size [*shape] or for all its actions.
        """
        self._planner = planner
        self._key = random.PRNGKey(0)  # of draws that change no return
        real = planner.compiled.REAL
        self.units = {name: jnp.asarray(units[name], real) for name in planner.rddl.action_fluents}
        self._hyperparams = unit_hyperparams(planner)
        self._exact = compile_exact_returns(planner, 1)
        self._call = jax.jit(self._advanced)

    def noop(self) -> Plans:
        """The plan that does nothing, without the axis of plans."""
        fluents = initial_values(self._planner).training.fluents
        horizon, real = self._planner.horizon, self._planner.compiled.REAL
        return {
            name: np.repeat(np.asarray(fluents[name], real)[:1], horizon, axis=0)
            for name in self.units
        }

    def begin(self, plans: Plans) -> Climb:
        """Before the first step of such plans, projected onto their box and tested."""
        given = jax.tree.map(lambda plan: jnp.asarray(plan, self._planner.compiled.REAL), plans)
        plans = jax.tree.map(np.asarray, jax.vmap(self._projected)(given))
        return Climb(plans, _ADAM.init(plans), plans, self.returns(plans))

    def returns(self, plans: Plans) -> np.ndarray:
        """Returns of plans on the exact model [L]; minus infinity for one that is no number."""
        return np.asarray(self._tested(plans))

    def climbed(self, climb: Climb, rates: np.ndarray, tests: int) -> Climb:
        """Adam's steps and then a test, so many times.

        Args:
          climb: of L plans.
          rates: Adam's step size of each plan, in units of its actions [L].
          tests: how many.
        """
        return self._call(climb, rates.astype(np.float32), tests)

    def _advanced(self, climb: Climb, rates: Array, tests: Array) -> Climb:
        gradient = jax.vmap(jax.grad(self._compile_return(len(rates))))

        def along(values: Array, like: Array) -> Array:
            return values.reshape(values.shape + (1,) * (like.ndim - values.ndim))

        def step(_: Any, climb: Climb) -> Climb:
            slopes = gradient(climb.plans)
            # per unit, and zero where it is no number
            slopes = {name: slope * self.units[name] for name, slope in slopes.items()}
            slopes = jax.tree.map(lambda g: jnp.where(jnp.isfinite(g), g, 0.0), slopes)
            moves, moments = _ADAM.update(slopes, climb.moments)
            moved = {
                name: plan + self.units[name] * along(rates, plan) * moves[name]
                for name, plan in climb.plans.items()
            }
            return climb._replace(plans=jax.vmap(self._projected)(moved), moments=moments)

        def block(_: Any, climb: Climb) -> Climb:
            climb = lax.fori_loop(0, _STEPS, step, climb)
            returns = self._tested(climb.plans)
            is_better = returns > climb.returns
            best = jax.tree.map(
                lambda new, old: jnp.where(along(is_better, new), new, old), climb.plans, climb.best
            )
            return climb._replace(best=best, returns=jnp.maximum(returns, climb.returns))

        return lax.fori_loop(0, tests, block, climb)

    def _compile_return(self, copies: int) -> Callable[[Plans], Array]:
        """The relaxed model's return of one plan [H, *shape], of so many side by side."""
        planner = self._planner
        # invariants would be looked at in every step; the exact test does that
        is_ending = bool(planner.rddl.terminations)
        options = RolloutOptions(copies=copies, check_constraints=is_ending)
        policy, horizon = planner.plan.train_policy, planner.horizon
        rollouts = compile_rollouts(planner.compiled, policy, horizon, 1, options)
        rollouts = stop_at_termination(rollouts) if is_ending else rollouts
        fluents, nonfluents = initial_values(planner).training
        start, model = repeated(fluents, 1), planner.compiled.model_aux["params"]
        discounts = float(planner.rddl.discount) ** jnp.arange(horizon)

        def total(plan: Plans) -> Array:
            log, _ = rollouts(self._key, plan, self._hyperparams, start, nonfluents, model)
            return jnp.sum(discounts * log["reward"][0])

        return total

    def _tested(self, plans: Plans) -> Array:
        returns = self._exact(self._key, plans)[:, 0]
        return jnp.where(jnp.isfinite(returns), returns, -jnp.inf)

    def _projected(self, plan: Plans) -> Plans:
        return self._planner.plan.projection(plan, self._hyperparams)[0]
