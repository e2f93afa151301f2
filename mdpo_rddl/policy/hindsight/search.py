"""The best plans that a search finds for scenarios whose random numbers are known."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from mdpo_rddl.planner.exact.scenarios import Scenarios
from mdpo_rddl.planner.planner import MDPOPlanner

Plans = dict[str, np.ndarray]

# plans of a scenario that are tried side by side
_LANES = 8
# steps of Adam from the best plans so far, and their sizes in units of the actions
_STEPS, _SMALLEST, _LARGEST = 150, 1e-3, 3e-2
# of the noise on them, in the same units
_NOISE = 0.1
_JUDGED_EVERY = 5
_FIRST, _SECOND, _TINY = 0.9, 0.99, 1e-12
# mutations before it is the gradient's turn again; components that a mutation changes
_MUTATIONS, _MOST_CHANGED, _WIDTH = 30, 8, 0.1


@dataclass(frozen=True, eq=False)
class Estimate:
    """What knowing the future would add, by the best plans that were found.

    Attributes:
      policy: discounted return of the policy in each scenario [N].
      plan: of the best plan found for each, at least the policy's [N].
      seconds: that it took.
    """

    policy: np.ndarray
    plan: np.ndarray
    seconds: float


@dataclass
class Incumbents:
    """The best plan of each scenario so far [N, H, *shape], and its return [N]."""

    plans: Plans
    returns: np.ndarray

    def take(self, plans: Plans, returns: np.ndarray) -> None:
        """Keeps those of plans [C, N, H, *shape] that return more [C, N]."""
        finite = np.where(np.isfinite(returns), returns, -np.inf)
        lane, scenarios = finite.argmax(axis=0), np.arange(finite.shape[1])
        better = finite[lane, scenarios] > self.returns
        for name, each in self.plans.items():
            each[better] = plans[name][lane, scenarios][better]
        self.returns[better] = finite[lane, scenarios][better]


def find_plans(
    planner: MDPOPlanner,
    policy: tuple[Any, Mapping[str, Any]],
    scenarios: tuple[int, int],
    seconds: float,
    clock: Callable[[], float] = time.monotonic,
) -> Estimate:
    """Searches plans for scenarios of the exact compiled model, from what the policy does.

    Real actions follow the gradient of the relaxed model with the scenario's random numbers; all
    actions are changed at random. What counts is the return on the exact model.

    Args:
      planner: the policy's.
      policy: its parameters and hyperparameters.
      scenarios: how many, and their seed.
      seconds: of the search, compilation included; a call under way is not interrupted.
      clock: tells the seconds.
    """
    began = clock()
    count, seed = scenarios
    compiled = Scenarios(planner, count, _LANES)
    key, rng = jax.random.PRNGKey(seed), np.random.default_rng(seed)
    played = compiled.compile_policy()(key, *policy)
    own = np.array(played.returns, float)
    best = Incumbents(
        {name: np.array(value) for name, value in played.plans.items()},
        np.where(np.isfinite(own), own, -np.inf),
    )
    search = _Search(planner, compiled, key, rng)
    # the plan may return something else than the policy only by rounding
    search.judge(best, best.plans)
    while clock() - began < seconds:
        if compiled.real_names:
            search.climb(best, lambda: clock() - began < seconds)
        for _ in range(_MUTATIONS):
            if clock() - began >= seconds:
                break
            search.judge(best, search.mutated(best.plans))
    return Estimate(own, best.returns, clock() - began)


class _Search:
    """The two ways to find better plans."""

    def __init__(
        self, planner: MDPOPlanner, compiled: Scenarios, key: Any, rng: np.random.Generator
    ) -> None:
        self._compiled, self._key, self._rng = compiled, key, rng
        self._kinds = {n: planner.rddl.variable_ranges[n] for n in planner.rddl.action_fluents}
        self._objects = planner.rddl.type_to_objects
        self._returns, self._gradient = compiled.compile_returns(), compiled.compile_gradient()
        self._units: Plans = {}

    def judge(self, best: Incumbents, plans: Plans) -> None:
        """Plays plans [C, N, ...], or [N, ...] in all lanes, and keeps the better ones."""
        if next(iter(plans.values())).ndim == next(iter(best.plans.values())).ndim:
            plans = _in_lanes(plans)
        best.take(plans, np.asarray(self._returns(self._key, plans), float))

    def climb(self, best: Incumbents, has_time: Callable[[], bool]) -> None:
        """Follows the gradient with Adam, in each lane with a step size of its own."""
        units = self._units_of(best.plans)
        rates = np.geomspace(_SMALLEST, _LARGEST, _LANES) * self._rng.uniform(0.3, 1.0)
        plans = _in_lanes(best.plans)
        first = {name: np.zeros_like(plans[name]) for name in units}
        second = {name: np.zeros_like(plans[name]) for name in units}
        for step in range(1, _STEPS + 1):
            if not has_time():
                return
            left = 1.0 - (step - 1) / _STEPS
            gradient = self._gradient(self._key, self._noisy(plans, units, left))
            moved = dict(plans)
            for name, unit in units.items():
                slope = np.asarray(gradient[name]) * unit
                first[name] = _FIRST * first[name] + (1.0 - _FIRST) * slope
                second[name] = _SECOND * second[name] + (1.0 - _SECOND) * slope**2
                mean = first[name] / (1.0 - _FIRST**step)
                size = np.sqrt(second[name] / (1.0 - _SECOND**step)) + _TINY
                rate = rates.reshape(-1, *([1] * (mean.ndim - 1)))
                # towards the end shorter steps
                rate = rate * left
                lower, upper = self._compiled.box(name)
                new = np.clip(plans[name] + rate * unit * mean / size, lower, upper)
                moved[name] = new.astype(plans[name].dtype)
            plans = moved
            if step % _JUDGED_EVERY == 0:
                self.judge(best, plans)

    def _noisy(self, plans: Plans, units: Plans, share: float) -> Plans:
        """Noise on real actions, in each lane of another size, wakes those without a gradient."""
        widths = share * _NOISE * (np.arange(_LANES) % 4) / 3
        noisy = dict(plans)
        for name, unit in units.items():
            width = widths.reshape(-1, *([1] * (plans[name].ndim - 1)))
            noise = width * unit * self._rng.standard_normal(plans[name].shape)
            noisy[name] = (plans[name] + noise).astype(plans[name].dtype)
        return noisy

    def mutated(self, plans: Plans) -> Plans:
        """Changes of a few components of each plan, others in each lane [C, N, H, *shape]."""
        mutants = _in_lanes(plans)
        names, sizes = list(mutants), [value[0, 0, 0].size for value in mutants.values()]
        units = self._units_of(plans)
        for lane, scenario in np.ndindex(next(iter(mutants.values())).shape[:2]):
            for _ in range(self._rng.integers(1, _MOST_CHANGED + 1)):
                name = names[self._rng.choice(len(names), p=np.array(sizes) / sum(sizes))]
                plan = mutants[name][lane, scenario]
                place = tuple(self._rng.integers(0, size) for size in plan.shape)
                plan[place] = self._changed(name, plan[place], place[1:], units)
        return mutants

    def _changed(self, name: str, value: Any, place: tuple[Any, ...], units: Plans) -> Any:
        kind, rng = self._kinds[name], self._rng
        if kind == "bool":
            return not value
        if kind in self._objects:
            return rng.integers(0, len(self._objects[kind]))
        lower, upper = (end[place] for end in self._compiled.box(name))
        if kind == "int":
            return np.clip(value + rng.choice((-1, 1)), lower, upper)
        return np.clip(value + rng.normal() * _WIDTH * units[name][place], lower, upper)

    def _units_of(self, plans: Plans) -> Plans:
        """What a step of 1 means for the real actions: their box, or how large they are."""
        for name in self._compiled.real_names:
            if name not in self._units:
                lower, upper = self._compiled.box(name)
                size = 1.0 + np.abs(plans[name]).max(axis=(0, 1))
                with np.errstate(over="ignore", invalid="ignore"):
                    width = upper - lower
                bounded = np.isfinite(width) & (width < 1e9)
                self._units[name] = np.where(bounded, width, size)
        return self._units


def _in_lanes(plans: Plans) -> Plans:
    return {name: np.repeat(value[np.newaxis], _LANES, axis=0) for name, value in plans.items()}
