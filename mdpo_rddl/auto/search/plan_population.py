"""Open-loop plans side by side on the exact model: what evolution and exploration ask."""

import dataclasses
import math
from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from mdpo_rddl.auto.common.draws import Draws, key_for
from mdpo_rddl.auto.common.gains import NoopReturn, return_to_beat_by_luck
from mdpo_rddl.auto.common.sizes import PLANS, visits_fit
from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.auto.probing.probing import Probe
from mdpo_rddl.auto.search.archive import Archive
from mdpo_rddl.auto.search.by_parts import ByParts
from mdpo_rddl.auto.search.evolution import (
    Breeding,
    Evaluation,
    Evolved,
    Goal,
    evolve,
)
from mdpo_rddl.auto.search.mutations import Layout, layout_of
from mdpo_rddl.planner.exact.exact import Visits, compile_exact_returns, compile_visits
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.planner.plans.parts import open_loop

PLAN = "plan"
"""The label of a policy whose plan was found from the no-op."""

_ROLLOUTS = 4


class PlanPopulation:
    """Plays and evolves the plans of policies.

    Attributes:
      deterministic: whether chance plays no part.
      iterations: done so far.
      elites: the best plans [E, H, D] of the evolution that goes on; None between evolutions.
      on_generation: called after each of its iterations.
    """

    def __init__(
        self,
        planner: MDPOPlanner,
        probe: Probe,
        seed: int,
        clock: Clock,
        deadline: float = math.inf,
    ) -> None:
        """Compiles nothing yet.

        Args:
          planner: with a `FeedbackPlan` that has a plan.
          probe: what probing found.
          seed: of the plans and of the model.
          clock: what is asked for the time.
          deadline: until when compilation is waited for, by the clock.
        """
        self._planner, self._probe, self._clock = planner, probe, clock
        self.deterministic = probe.deterministic
        # as many rollouts in all, whether one shows what a plan returns or not
        self._rollouts = 1 if probe.deterministic else _ROLLOUTS
        self._population = PLANS // self._rollouts
        self._has_states = visits_fit(planner)
        self._visits = ByParts(self._make, clock, deadline)
        self._seed = seed
        self._key = key_for(Draws.PLANS, seed)
        self._random = np.random.default_rng([seed, 2])
        self.iterations = 0
        self.elites: np.ndarray | None = None
        self.on_generation: Callable[[], None] = lambda: None

    @property
    def compile_seconds(self) -> float:
        """What the first population took longer than the latest, for all programs."""
        return self._visits.compile_seconds

    @property
    def is_compiled(self) -> bool:
        """Whether plans were played already."""
        return self._visits.is_compiled()

    def compile(self, params: Params) -> None:
        """Plays a population, unless one was played: the first one compiles the program."""
        layout, plan = self._layout(params), self.plan_of(params)
        plans = np.broadcast_to(plan, (self._population, *plan.shape))
        population = {**self._repeated(params), "plan": layout.tree(plans)}
        if not self._visits.is_compiled(population):
            self._visits(self._key, population)

    def archive(self, params: Params) -> Archive | None:
        """An empty archive for plans; None without a state, or with too many to be looked at."""
        scales = self._probe.state_scales if self._has_states else {}
        return Archive(self._layout(params), scales, self._seed) if scales else None

    def goal(
        self, until: float, noop: NoopReturn, incumbent_return: float, restarting: bool
    ) -> Goal:
        """A search for plans that beat the no-op.

        Args:
          until: when to end, by the clock.
          noop: its return.
          incumbent_return: ends early if it would not be reached in time.
          restarting: whether to begin again from the no-op where nothing more is gained. That
            can be seen only if chance plays no part.
        """
        converging = restarting and self.deterministic
        to_beat = return_to_beat_by_luck(noop, self._rollouts)
        return Goal(until, to_beat, incumbent_return, until_converged=converging)

    def evolved(
        self,
        params: Params,
        goal: Goal,
        archive: Archive | None = None,
    ) -> Params:
        """A policy with a better plan; an evolution that has converged begins again.

        Args:
          params: of the policy with the first plan; all but the plan stays.
          goal: when to end.
          archive: where plans have led; None for no exploration.
        """
        layout = self._layout(params)
        start = layout.vector(params["plan"])[np.newaxis]
        best = result = self._evolve(params, start, goal, archive)
        restarted = dataclasses.replace(goal, incumbent_return=-math.inf)
        while result.converged and best.best >= goal.incumbent_return:
            result = self._evolve(params, np.zeros_like(start), restarted, archive, best.elites[:1])
            best = max(best, result, key=lambda evolved: evolved.best)
        return self.with_plan(params, best.elites[0])

    def plan_of(self, params: Params) -> np.ndarray:
        """A policy's plan [H, D]."""
        return self._layout(params).vector(params["plan"])

    def with_plan(self, params: Params, plan: np.ndarray) -> Params:
        """A policy with another plan [H, D]."""
        tree = self._layout(params).tree(plan)
        return {**params, "plan": jax.tree.map(jnp.asarray, tree)}

    def _evolve(
        self,
        params: Params,
        start: np.ndarray,
        goal: Goal,
        archive: Archive | None,
        earlier: np.ndarray | None = None,
    ) -> Evolved:
        """One evolution; an earlier one's best plans [E, H, D] stay among the elites to be kept."""
        layout, others, begin = self._layout(params), self._repeated(params), self.iterations

        def evaluate(iteration: int, plans: np.ndarray) -> Evaluation:
            key = jax.random.fold_in(self._key, begin + iteration)
            found = self._visits(key, {**others, "plan": layout.tree(plans)})
            returns = np.mean(np.asarray(found.returns, float), axis=1)
            return Evaluation(returns, lambda: _of_first_rollout(found.states))

        def keep(elites: np.ndarray) -> None:
            self.elites = elites if earlier is None else np.concatenate([earlier, elites])
            self.on_generation()

        breeding = Breeding(layout, self._population, self._random, archive, self._clock, keep)
        self.elites = None
        result = evolve(evaluate, start, breeding, goal)
        self.elites = None
        self.iterations += result.iterations
        return result

    def _layout(self, params: Params) -> Layout:
        bools = [name for name in params["plan"] if name not in self._planner.plan.units]
        return layout_of(params["plan"], bools)

    def _make(self) -> Callable[[Array, Params], Visits]:
        if self._has_states:
            visits = compile_visits(self._planner, self._rollouts)
        else:
            visits = _without_states(self._planner, self._rollouts)
        return lambda key, params: jax.block_until_ready(visits(key, params))

    def _repeated(self, params: Params) -> Params:
        """All parts but the plan that have an effect, once for each policy of a population."""
        alone = open_loop(params)
        kept = params if alone is None else alone
        others = {name: part for name, part in kept.items() if name != "plan"}
        count = self._population
        each = jax.tree.map(lambda leaf: np.broadcast_to(leaf, (count, *np.shape(leaf))), others)
        return dict(jax.device_put(each))


def _without_states(planner: MDPOPlanner, rollouts: int) -> Callable[[Array, Params], Visits]:
    """As `compile_visits`, without what is seen."""
    play = compile_exact_returns(planner, rollouts)

    def visits(key: Array, params: Params) -> Visits:
        return Visits(play(key, params), {})

    return visits


def _of_first_rollout(states: Mapping[str, Array]) -> dict[str, np.ndarray]:
    return {name: np.asarray(values[:, 0]) for name, values in states.items()}
