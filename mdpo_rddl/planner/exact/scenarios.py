"""Plans of whole episodes on fixed streams of random numbers, compiled.

A scenario is a rollout's random numbers on the exact model. They do not depend on the actions, so
that a policy and any plan can be played on the same ones. A plan is a tree of action fluents, each
[N, H, *shape]: one sequence of actions for each of N scenarios.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.legal import LegalActions
from mdpo_rddl.planner.plans.opened import open_plan
from mdpo_rddl.planner.programs.quick import light_jit
from mdpo_rddl.planner.rollouts.compiled import PerturbedModel, RolloutOptions, compile_rollouts
from mdpo_rddl.planner.rollouts.plan_memory import NO_MEMORY
from mdpo_rddl.planner.rollouts.termination import stop_at_termination
from mdpo_rddl.planner.start import Start, initial_values, unit_hyperparams
from mdpo_rddl.problem.limits import group_limits

Plans = dict[str, Any]
"""Per action fluent its values."""


class Played(NamedTuple):
    """What a policy has done in the scenarios.

    Attributes:
      plans: its legal actions.
      returns: discounted [N].
    """

    plans: Plans
    returns: Array


class Scenarios:
    """Compiles what is played on the scenarios of one random key."""

    def __init__(self, planner: MDPOPlanner, count: int, lanes: int) -> None:
        """Reads the models.

        Args:
          planner: whose policy and models they are.
          count: number N of scenarios.
          lanes: number C of plans of each that are played side by side.
        """
        self._planner, self._count, self._lanes = planner, count, lanes
        self._stopping = bool(planner.rddl.terminations or planner.rddl.invariants)
        self._horizon = planner.rddl.horizon
        self._discounts = float(planner.rddl.discount) ** jnp.arange(self._horizon)
        limits = [*group_limits(planner.rddl)[0], *getattr(planner.plan, "concurrency", [])]
        self._legal = LegalActions(planner.test_compiled, limits)

    @property
    def real_names(self) -> list[str]:
        """Names of the real action fluents."""
        rddl = self._planner.rddl
        return [n for n in rddl.action_fluents if rddl.variable_ranges[n] == "real"]

    def box(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of an action fluent [*shape], infinite where there is none."""
        compiled = self._planner.test_compiled
        shape = np.shape(compiled.init_values[name])
        lower, upper = compiled.constraints.bounds[name]
        return np.broadcast_to(lower, shape), np.broadcast_to(upper, shape)

    def compile_policy(self) -> Callable[[Array, Any, Mapping[str, Any]], Played]:
        """A function of a key, the policy's parameters and its hyperparameters."""
        planner, model = self._planner, self._planner.test_compiled
        rollouts = self._rollouts(model, planner.legal_policy, path=True, differentiated=False)
        start, names = self._start(initial_values(planner).test), list(planner.rddl.action_fluents)

        def play(key: Array, params: Any, hyperparams: Mapping[str, Any]) -> Played:
            hyperparams = {**unit_hyperparams(planner), **hyperparams}
            parameters = model.model_aux["params"]
            log, _ = rollouts(key, params, hyperparams, *start, parameters)
            plans = {name: log["fluents"][name] for name in names}
            return Played(plans, self._total(log))

        return light_jit(play)

    def compile_returns(self) -> Callable[[Array, Plans], Array]:
        """A function of the key and of plans [C, N, H, *shape] that gives their returns [C, N].

        An illegal action is replaced as in play.
        """
        model = self._planner.test_compiled
        play = self._compile_plans(model, self._made_legal, differentiated=False)
        return light_jit(jax.vmap(play, (None, 0)))

    def compile_gradient(self) -> Callable[[Array, Plans], Plans]:
        """A function of the key and of plans [C, N, H, *shape]: the gradient of their returns.

        It is that of the relaxed model, for the real actions; the others stay as they are.
        """
        reals = self.real_names
        play = self._compile_plans(self._planner.compiled, self._inside, differentiated=True)

        def total(moving: Plans, key: Array, plans: Plans) -> Array:
            return jnp.sum(play(key, {**plans, **moving}))

        def gradient(key: Array, plans: Plans) -> Plans:
            moving = {name: plans[name] for name in reals}
            found = jax.grad(total)(moving, key, plans)
            return jax.tree.map(lambda leaf: jnp.where(jnp.isfinite(leaf), leaf, 0.0), found)

        return jax.jit(jax.vmap(gradient, (None, 0)))

    def _compile_plans(
        self, model: Any, clean: Callable[[Plans, Any], Plans], differentiated: bool
    ) -> Callable[[Array, Plans], Array]:
        """A function of the key and of plans [N, H, *shape] that gives returns [N]."""

        values = initial_values(self._planner)
        start = self._start(values.training if differentiated else values.test)

        def policy(*arguments):
            *_, state, _, given = arguments
            # the relaxed model knows no bools
            actions = clean(given, state)
            return {name: each.astype(start.fluents[name].dtype) for name, each in actions.items()}

        rollouts = self._rollouts(model, policy, path=False, differentiated=differentiated)

        def play(key: Array, plans: Plans) -> Array:
            perturbed = PerturbedModel(model.model_aux["params"], plans)
            return self._total(rollouts(key, {}, {}, *start, perturbed)[0])

        return play

    def _rollouts(
        self, model: Any, policy: Callable[..., Any], *, path: bool, differentiated: bool
    ) -> Callable[..., Any]:
        options = RolloutOptions(
            history_dependent=path and self._planner.plan.history_dependent,
            check_constraints=self._stopping,
            cache_path_info=path,
            differentiated=differentiated,
            copies=self._lanes if differentiated else 1,
            memory=open_plan(self._planner.plan).memory if path else NO_MEMORY,
        )
        rollouts = compile_rollouts(model, policy, self._horizon, self._count, options)
        return stop_at_termination(rollouts) if self._stopping else rollouts

    def _start(self, start: Start) -> Start:
        repeat = partial(jnp.repeat, repeats=self._count, axis=0)
        return Start(jax.tree.map(lambda leaf: repeat(leaf[:1]), start.fluents), start.nonfluents)

    def _total(self, log: Mapping[str, Array]) -> Array:
        return jnp.sum(self._discounts * log["reward"], axis=-1)

    def _inside(self, given: Plans, state: Any) -> Plans:
        """Real actions in their box; what it cuts off keeps a gradient, or it would not return."""
        cleaned = dict(given)
        for name in self.real_names:
            clipped = jnp.clip(given[name], *self.box(name))
            cleaned[name] = given[name] + jax.lax.stop_gradient(clipped - given[name])
        return cleaned

    def _made_legal(self, given: Plans, state: Any) -> Plans:
        inside = self._inside(given, state)
        if not self._legal.is_needed:
            return inside
        kinds = self._planner.rddl.variable_ranges
        likely = {n: v.astype(float) for n, v in inside.items() if kinds[n] == "bool"}
        return self._legal(inside, likely, state)
