"""Evolution of open-loop plans: the best plans so far, changed here and there."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.auto.search.archive import Archive
from mdpo_rddl.auto.search.mutations import Layout, mutants


class Evaluation(NamedTuple):
    """What plans have shown.

    Attributes:
      returns: mean returns [P].
      visited: gives the states that were visited [P, H, *shape].
    """

    returns: np.ndarray
    visited: Callable[[], dict[str, np.ndarray]]


Evaluate = Callable[[int, np.ndarray], Evaluation]
"""(iteration, plans [P, H, D]) -> their evaluation."""

_ELITES = 8
_EXPLORERS = 0.5
_PATIENCE = 0.3
# an evolution may have converged after so many iterations, if a gain is this share of all it gained
_LEAST_ITERATIONS, _LEAST_GAIN = 200, 0.01


def _ignore(elites: np.ndarray) -> None:
    del elites


@dataclass(frozen=True)
class Goal:
    """What an evolution is after.

    Attributes:
      until: when to end, by the clock.
      return_to_beat: what a plan must return more than for an exploration to end.
      incumbent_return: the evolution ends early if at its pace it would not return so much in
        time.
      until_converged: whether it ends early, too, once it has gained nothing for as long as it
        had taken to get there.
    """

    until: float
    return_to_beat: float
    incumbent_return: float = -math.inf
    until_converged: bool = False


@dataclass(frozen=True)
class Breeding:
    """How plans are made.

    Attributes:
      layout: of the plans.
      population: plans P of an iteration.
      random: generator, which moves on.
      archive: of cells; None for no exploration, whatever the return to beat.
      clock: what is asked for the time.
      on_generation: is given the best plans [E, H, D] after each iteration.
    """

    layout: Layout
    population: int
    random: np.random.Generator
    archive: Archive | None = None
    clock: Clock = time.monotonic
    on_generation: Callable[[np.ndarray], None] = _ignore


@dataclass(frozen=True)
class Evolved:
    """Where an evolution ended.

    Attributes:
      elites: the best plans [E, H, D], the very best first.
      best: what the very best returned in the last iteration.
      iterations: done.
      converged: whether it ended because nothing was gained any more.
    """

    elites: np.ndarray
    best: float
    iterations: int
    converged: bool


def evolve(evaluate: Evaluate, start: np.ndarray, breeding: Breeding, goal: Goal) -> Evolved:
    """Improves plans until the time is over.

    In every iteration the best plans and their mutants meet the same random numbers, new ones each
    time, and the best of all stay. Until one beats the goal's return, half of the plans are
    the archive's, which goes where no plan has been.

    Args:
      evaluate: see `Evaluate`; iterations count from 0.
      start: the first plans [E, H, D].
      breeding: how plans are made.
      goal: when to end.
    """
    evolution = _Evolution(start, breeding, goal)
    while evolution.goes_on():
        evolution.iterate(evaluate)
    return Evolved(evolution.elites, evolution.best, evolution.iterations, evolution.has_converged)


class _Evolution:
    """The state of one evolution."""

    def __init__(self, start: np.ndarray, breeding: Breeding, goal: Goal) -> None:
        self._breeding, self._goal = breeding, goal
        self.elites, self.best, self.iterations = start, -math.inf, 0
        self._explores = breeding.archive is not None
        self._pace = _Pace(breeding.clock(), -math.inf)
        self._began = self._pace.checked
        self._first = self._record = -math.inf
        self._gained_at = 0

    @property
    def has_converged(self) -> bool:
        waited = self.iterations > max(2 * self._gained_at, _LEAST_ITERATIONS)
        return self._goal.until_converged and waited

    def goes_on(self) -> bool:
        now = self._breeding.clock()
        if now >= self._goal.until or self.has_converged:
            return False
        return self._explores or not self._is_too_slow(now)

    def _is_too_slow(self, now: float) -> bool:
        """Whether at the pace since the last check the incumbent's return is out of reach."""
        goal, pace = self._goal, self._pace
        if self.best >= goal.incumbent_return:
            return False
        if now - pace.checked <= _PATIENCE * (goal.until - self._began):
            return False
        slope = (self.best - pace.best) / (now - pace.checked)
        if self.best + slope * (goal.until - now) < goal.incumbent_return:
            return True
        self._pace = _Pace(now, self.best)
        return False

    def iterate(self, evaluate: Evaluate) -> None:
        breeding = self._breeding
        count = breeding.population - len(self.elites)
        children = mutants(self.elites, count, breeding.layout, breeding.random)
        if breeding.archive is not None and self._explores and len(breeding.archive):
            explorers = breeding.archive.plans(int(_EXPLORERS * len(children)))
            children[: len(explorers)] = explorers
        # a child that is as good as its parent takes its place: plateaus are crossed that way
        plans = np.concatenate([children, self.elites])
        found = evaluate(self.iterations, plans)
        returns = _known(found.returns)
        self._explores &= not np.max(returns) > self._goal.return_to_beat
        chosen = np.argsort(-returns, kind="stable")[:_ELITES]
        self.elites, self.best = plans[chosen], float(returns[chosen[0]])
        if not self.iterations:  # which may have compiled
            self._began = breeding.clock()
            self._pace = _Pace(self._began, self.best)
            self._first = self._record = self.best
        self.iterations += 1
        if self.best > self._record + _LEAST_GAIN * (self.best - self._first):
            self._record, self._gained_at = self.best, self.iterations
        if breeding.archive is not None and self._explores:
            breeding.archive.add(plans, found.visited())
        breeding.on_generation(self.elites)


def _known(returns: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(returns), returns, -np.inf)


@dataclass(frozen=True)
class _Pace:
    """When the progress was last looked at, and the best return then."""

    checked: float
    best: float
