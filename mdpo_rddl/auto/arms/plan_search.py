"""The part of the recipe that looks for an open-loop plan on the exact model."""

import dataclasses
import math
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.auto.arms.archive import Archive
from mdpo_rddl.auto.arms.evolution import Evaluate, Evaluation, Evolved, Goal, evolve
from mdpo_rddl.auto.arms.mutations import Layout, layout_of
from mdpo_rddl.auto.probing import Probe
from mdpo_rddl.auto.sizes import PLANS
from mdpo_rddl.planner.exact import compile_visits
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params

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
        self._deterministic = found.deterministic
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
        restarting: bool = False,
    ) -> Params:
        """A policy with a better plan.

        Args:
          params: of the policy with the first plan; all but the plan stays.
          until: when to end, by `time.monotonic`.
          rival: a return; ends early if it would not be reached in time, or was not where nothing
            more is gained.
          exploring: whether to go where no plan has been until one earns more than the bar.
          restarting: whether to begin again with doing nothing where nothing more is gained.
            That can be seen only if chance does not matter.
        """
        bools = [name for name in params["plan"] if name not in self._planner.feedback_plan.units]
        layout = layout_of(params["plan"], bools)
        start = layout.vector(params["plan"])[np.newaxis]
        rest = {name: part for name, part in params.items() if name != "plan"}
        rest = jax.tree.map(self._repeated, rest)
        exploring = exploring and bool(self._scales)  # without a state there is nowhere to go
        if exploring and self._archive is None:
            self._archive = Archive(layout, self._scales, self._seed)

        def evaluate(iteration: int, plans: np.ndarray) -> Evaluation:
            key = jax.random.fold_in(self._key, iteration)
            returns, states = self._play(key, {**rest, "plan": layout.tree(plans)})
            return np.mean(np.asarray(returns, float), axis=1), lambda: _of_first_rollout(states)

        goal = Goal(until, self.bar, rival, until_settled=restarting and self._deterministic)
        archive = self._archive if exploring else None
        best = result = self._evolve(evaluate, start, layout, goal, archive)
        goal = dataclasses.replace(goal, rival=-math.inf)
        while result.settled and best.best >= rival:
            result = self._evolve(evaluate, np.zeros_like(start), layout, goal, archive)
            best = max(best, result, key=lambda evolved: evolved.best)
        return {**params, "plan": jax.tree.map(jnp.asarray, layout.tree(best.elites[0]))}

    def _evolve(
        self,
        evaluate: Evaluate,
        start: np.ndarray,
        layout: Layout,
        goal: Goal,
        archive: Archive | None,
    ) -> Evolved:
        result = evolve(
            evaluate,
            start,
            layout,
            goal,
            population=self._population,
            begin=self.iterations,
            archive=archive,
            random=self._random,
        )
        self.iterations += result.iterations
        return result

    def _repeated(self, leaf: Array) -> Array:
        return jnp.broadcast_to(leaf, (self._population, *np.shape(leaf)))


def _of_first_rollout(states: Mapping[str, Array]) -> dict[str, np.ndarray]:
    return {name: np.asarray(values[:, 0]) for name, values in states.items()}
