"""Search for an open-loop plan: the best plans so far, changed here and there."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mdpo_rddl.auto.arms.archive import Archive
from mdpo_rddl.auto.arms.mutations import Layout, mutants

Evaluation = tuple[np.ndarray, Callable[[], dict[str, np.ndarray]]]
"""Mean returns [P], and what gives the states that were visited [P, H, *shape]."""

Evaluate = Callable[[int, np.ndarray], Evaluation]
"""(iteration, plans [P, H, D]) -> their evaluation."""

_ELITES = 8
_EXPLORERS = 0.5
_PATIENCE = 0.3
# an evolution may have settled after so many iterations, if a gain is this share of all it gained
_LEAST_ITERATIONS, _LEAST_GAIN = 200, 0.01


@dataclass(frozen=True)
class Goal:
    """What a search is after.

    Attributes:
      until: when to end, by `time.monotonic`.
      bar: what a plan must earn more than for an exploration to end.
      rival: the search ends early if at its pace it would not earn so much in time.
      until_settled: whether it ends early, too, once it has gained nothing for as long as it had
        taken to get there.
    """

    until: float
    bar: float
    rival: float = -math.inf
    until_settled: bool = False


@dataclass(frozen=True)
class Evolved:
    """What an evolution found.

    Attributes:
      elites: the best plans [E, H, D], the very best first.
      best: what the very best earned in the last iteration.
      iterations: done.
      settled: whether it ended because nothing was gained any more.
    """

    elites: np.ndarray
    best: float
    iterations: int
    settled: bool


def evolve(
    evaluate: Evaluate,
    start: np.ndarray,
    layout: Layout,
    goal: Goal,
    *,
    population: int,
    begin: int,
    archive: Archive | None,
    random: np.random.Generator,
) -> Evolved:
    """Improves plans until the time is over.

    In every iteration the best plans and their mutants meet the same random numbers, new ones each
    time, and the best of all stay. Until one earns more than the bar, half of the plans are
    the archive's, which goes where no plan has been.

    Args:
      evaluate: see `Evaluate`.
      start: the first plans [E, H, D].
      layout: of the plans.
      goal: see `Goal`.
      population: plans P of an iteration.
      begin: number of the first iteration.
      archive: of cells; None for no exploration, whatever the bar.
      random: generator.
    """
    elites, best, found, iterations = start, -np.inf, archive is None, 0
    begun = time.monotonic()
    checked, earlier = begun, -np.inf
    first = record = -np.inf
    gained = 0
    settled = False
    while (now := time.monotonic()) < goal.until and not settled:
        if found and best < goal.rival and now - checked > _PATIENCE * (goal.until - begun):
            if best + (best - earlier) / (now - checked) * (goal.until - now) < goal.rival:
                break
            checked, earlier = now, best
        children = mutants(elites, population - len(elites), layout, random)
        if archive and not found:
            explorers = archive.plans(int(_EXPLORERS * len(children)))
            children[: len(explorers)] = explorers
        # a child that is as good as its parent takes its place: plateaus are crossed that way
        plans = np.concatenate([children, elites])
        returns, visited = evaluate(begin + iterations, plans)
        returns = np.where(np.isfinite(returns), returns, -np.inf)
        chosen = np.argsort(-returns, kind="stable")[:_ELITES]
        elites, best = plans[chosen], float(returns[chosen[0]])
        if not iterations:  # which may have compiled
            begun, checked, earlier = time.monotonic(), time.monotonic(), best
            first = record = best
        iterations += 1
        if best > record + _LEAST_GAIN * (best - first):
            record, gained = best, iterations
        settled = goal.until_settled and iterations > max(2 * gained, _LEAST_ITERATIONS)
        found = found or best > goal.bar
        if archive is not None and not found:
            archive.add(plans, visited())
    return Evolved(elites, best, iterations, settled)
