"""The part of the recipe that looks for an open-loop plan on the exact model."""

import math
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.auto.evolution import Evaluation, Goal, evolve
from mdpo_rddl.auto.exploring import Archive
from mdpo_rddl.auto.plans import layout_of
from mdpo_rddl.auto.probing import Probe
from mdpo_rddl.auto.sizes import PLANS
from mdpo_rddl.feedback import Params
from mdpo_rddl.jaxplan.exact import compile_visits
from mdpo_rddl.jaxplan.planner import MDPOPlanner

_ROLLOUTS = 4
# what a gain must be of the return of doing nothing, to be one
_GAIN = 0.005


class PlanSearch:
    """Searches for plans, and remembers where they led.

    Attributes:
      bar: what doing nothing earns, and a little more.
      iterations: done so far.
    """

    def __init__(self, planner: MDPOPlanner, found: Probe, seed: int) -> None:
        """Compiles nothing yet.

        Args:
          planner: with a `FeedbackPlan` that has a plan.
          found: by probing.
          seed: of the plans and of the model.
        """
        self._planner = planner
        # as many rollouts in all, whether one shows what a plan earns or not
        rollouts = 1 if found.deterministic else _ROLLOUTS
        self._population = PLANS // rollouts
        self._play = compile_visits(planner, rollouts)
        self._key = jax.random.fold_in(jax.random.PRNGKey(seed), 2)
        self._random = np.random.default_rng([seed, 2])
        self._seed, self._scales = seed, found.state_scales
        self._archive: Archive | None = None
        self.bar = found.nothing + _GAIN * abs(found.nothing)
        self.iterations = 0

    def search(
        self,
        params: Params,
        *,
        until: float,
        rival: float = -math.inf,
        exploring: bool = False,
    ) -> Params:
        """A policy with a better plan.

        Args:
          params: of the policy with the first plan; all but the plan stays.
          until: when to end, by `time.monotonic`.
          rival: a return; ends early if it would not be reached in time.
          exploring: whether to go where no plan has been until one earns more than the bar.
        """
        bools = [name for name in params["plan"] if name not in self._planner.plan.units]
        layout = layout_of(params["plan"], bools)
        start = layout.vector(params["plan"])
        rest = {name: part for name, part in params.items() if name != "plan"}
        rest = jax.tree.map(self._repeated, rest)
        exploring = exploring and bool(self._scales)  # without a state there is nowhere to go
        if exploring and self._archive is None:
            self._archive = Archive(layout, self._scales, self._seed)

        def evaluate(iteration: int, plans: np.ndarray) -> Evaluation:
            key = jax.random.fold_in(self._key, iteration)
            returns, states = self._play(key, {**rest, "plan": layout.tree(plans)})
            return np.mean(np.asarray(returns, float), axis=1), lambda: _of_first_rollout(states)

        result = evolve(
            evaluate,
            start[np.newaxis],
            layout,
            Goal(until, self.bar, rival),
            population=self._population,
            begin=self.iterations,
            archive=self._archive if exploring else None,
            random=self._random,
        )
        self.iterations += result.iterations
        return {**params, "plan": jax.tree.map(jnp.asarray, layout.tree(result.elites[0]))}

    def _repeated(self, leaf: Array) -> Array:
        return jnp.broadcast_to(leaf, (self._population, *np.shape(leaf)))


def _of_first_rollout(states: Mapping[str, Array]) -> dict[str, np.ndarray]:
    return {name: np.asarray(values[:, 0]) for name, values in states.items()}
