"""Feedback policies side by side on the exact model: what searches for their weights ask."""

import logging
import math
from typing import NamedTuple

import jax
import numpy as np

from mdpo_rddl.auto.compilations import compiled_within
from mdpo_rddl.auto.draws import Draws, key_for
from mdpo_rddl.auto.search.weights import Weights, weights_of
from mdpo_rddl.auto.sizes import Size, fitting_size
from mdpo_rddl.auto.timing import Clock, Timed
from mdpo_rddl.planner.exact import compile_exact_returns
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params

logger = logging.getLogger(__name__)

# a search of fewer iterations than that finds nothing: then one rollout has to do
_FEWEST_ITERATIONS = 500
_FINAL_BATCHES = 8
# the judge's rollouts take longer than those of a population do
_TOO_SLOW_BY = 2.0
_SLOW_SECONDS = 0.5


class Wanted(NamedTuple):
    """What a population is compiled for.

    Attributes:
      share: of the time left after compilation, that the first search has.
      rollout_seconds: of one rollout, as far as is known; no program is compiled for so many
        rollouts that by this it would be too slow.
      deterministic: whether chance plays no part in the return, so that one rollout is enough.
    """

    share: float
    rollout_seconds: float = 0.0
    deterministic: bool = False


class PopulationReturns:
    """Returns of a population on the exact model.

    Attributes:
      population: candidates P of an iteration.
      side_by_side: candidates that are computed at once; all if None.
    """

    def __init__(
        self,
        planner: MDPOPlanner,
        size: Size,
        seed: int,
        clock: Clock,
        deadline: float = math.inf,
    ) -> None:
        """Compiles when it is first called, until the deadline."""
        self.population, self.side_by_side = size.population, size.side_by_side
        returns = compiled_within(
            deadline - clock(),
            lambda: compile_exact_returns(planner, size.rollouts, size.side_by_side),
        )
        self._returns = Timed(
            lambda key, params: np.asarray(returns(key, params), float), clock, deadline
        )
        self._key = key_for(Draws.POPULATION, seed)

    @property
    def seconds(self) -> float:
        """Of the latest population."""
        return self._returns.seconds

    @property
    def compile_seconds(self) -> float:
        """What the first population took longer."""
        return self._returns.compile_seconds

    def __call__(self, weights: Weights, iteration: int, vectors: np.ndarray) -> np.ndarray:
        """Mean returns [P] of vectors [P, D]; all candidates see the same random numbers."""
        key = jax.random.fold_in(self._key, iteration)
        return np.mean(self._returns(key, weights.batch(vectors)), axis=1)

    def returns(self, params: Params) -> np.ndarray:
        """Returns [P, N] of policies whose parameters have a leading axis P."""
        return self._returns(self._key, params)

    def best(self, weights: Weights, vectors: list[np.ndarray]) -> np.ndarray:
        """The vector [D] of the largest mean return in fresh rollouts."""
        places = [number % len(vectors) for number in range(self.population)]
        batch = np.stack([vectors[place] for place in places])
        batches = 1 if self.seconds > _SLOW_SECONDS else _FINAL_BATCHES
        fresh = [self(weights, 10**6 + number, batch) for number in range(batches)]
        means = np.mean(fresh, axis=0)[: len(vectors)]
        return vectors[int(np.argmax(np.where(np.isfinite(means), means, -np.inf)))]


def compile_population(
    planner: MDPOPlanner,
    seed: int,
    wanted: Wanted,
    clock: Clock,
    deadline: float = math.inf,
) -> PopulationReturns:
    """Compiles with so few rollouts that a search has enough iterations.

    Args:
      planner: with a `FeedbackPlan`.
      seed: of the model.
      wanted: what for.
      clock: what times the rollouts.
      deadline: until when compilation is waited for, by the clock.

    Raises:
      TooLateError: if the deadline comes before.
    """
    size = fitting_size(planner)
    shared = weights_of(planner.feedback_plan.noop(seed), ["shared"])
    zeros = np.zeros((size.population, shared.start.size))
    rollouts_tried = {1} if wanted.deterministic else {size.rollouts, 1}
    for rollouts in sorted(rollouts_tried, reverse=True):
        fewer = size._replace(rollouts=rollouts)
        least = _FEWEST_ITERATIONS * size.population * rollouts * wanted.rollout_seconds
        if rollouts > 1 and least > _TOO_SLOW_BY * wanted.share * (deadline - clock()):
            continue
        population = PopulationReturns(planner, fewer, seed, clock, deadline)
        population(shared, 0, zeros)
        if size.side_by_side is None:
            population(shared, 0, zeros)  # the first call compiled
        logger.info("%d rollouts of %d take %.3g s", rollouts, size.population, population.seconds)
        search_seconds = wanted.share * (deadline - clock())
        # another program takes as long to compile: less of it than of the search it is for
        is_too_late = population.compile_seconds > search_seconds
        if population.seconds * _FEWEST_ITERATIONS < search_seconds or is_too_late:
            break
    return population
