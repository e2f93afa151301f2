"""Feedback policies side by side on the exact model: what searches for their weights ask."""

import logging
import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

import jax
import numpy as np

from mdpo_rddl.auto.common.draws import Draws, key_for
from mdpo_rddl.auto.common.sizes import Size, fitting_size
from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.auto.search.by_parts import ByParts
from mdpo_rddl.auto.search.one_by_one import POLICIES, OneByOne
from mdpo_rddl.auto.search.weights import Weights, weights_of
from mdpo_rddl.planner.exact.exact import compile_exact_returns
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.problem.evaluation import LOST

logger = logging.getLogger(__name__)

PROGRAMS = 1.5
"""So many times as long as the judge's program does that of a population take to compile."""
# a search of fewer iterations than that finds nothing: then one rollout has to do; with as many
# rollouts as tell how rare an error is, fewer iterations find a policy that avoids it
_FEWEST_ITERATIONS, _FEWEST_AVOIDING = 500, 100
# one rollout does not show a rare error: so many times fewer are the fewest there
_FEWER_AVOIDING = 4
# of each, with fresh random numbers, where the best of several is told
_FINAL_BATCHES, _FINAL_ROLLOUTS = 8, 32
# where errors are avoided: as many as show an error that most judges would not see; an iteration
# ends before, once so many of its candidates have made one
_MOST_AVOIDING, _LOSING_SHARE = 4096, 0.5
# the judge's rollouts take longer than those of a population do
_TOO_SLOW_BY = 2.0
# where an error is to be seen many rollouts are worth a try: side by side they are quicker each
_TOO_SLOW_AVOIDING = 8.0
_SLOW_SECONDS = 0.5
# of the time left, that the program may take
_LONGEST_SHARE = 0.8


class Wanted(NamedTuple):
    """What a population is compiled for.

    Attributes:
      share: of the time left after compilation, that the first search has.
      rollout_seconds: of one rollout, as far as is known; no program is compiled for so many
        rollouts that by this it would be too slow.
      deterministic: whether chance plays no part in the return, so that one rollout is enough.
      program_seconds: what a program is likely to take to compile.
      judged: rollouts of the judge's program, which plays single policies; of use only where
        `program_seconds` is known, since it is there then.
    """

    share: float
    rollout_seconds: float = 0.0
    deterministic: bool = False
    program_seconds: float = 0.0
    judged: int = 0


class Program(Protocol):
    """Plays policies, all in the same rollouts."""

    @property
    def seconds(self) -> float:
        """Of the latest population."""

    @property
    def compile_seconds(self) -> float:
        """What the first population took longer."""

    def __call__(self, key: jax.Array, params: Params) -> np.ndarray:
        """Returns [P, N] of policies whose parameters have a leading axis P."""


class PopulationReturns:
    """Returns of a population on the exact model.

    Attributes:
      population: candidates P of an iteration.
    """

    def __init__(self, program: Program, size: Size, seed: int, avoids: bool = False) -> None:
        """Plays nothing yet.

        Args:
          program: plays `size.population` policies; without the parts that have no effect, if it
            is one for each set of parts.
          size: of a population.
          seed: of the rollouts.
          avoids: whether rollouts may be `LOST`, and more of them are played to tell how often.
        """
        self.population = size.population
        self._program, self._rollouts, self._avoids = program, size.rollouts, avoids
        self._by_parts = program if isinstance(program, ByParts) else None
        self._key = key_for(Draws.POPULATION, seed)
        self._calls = 1

    @property
    def seconds(self) -> float:
        """Of the latest population, all of its rollouts."""
        return self._calls * self._program.seconds

    @property
    def compile_seconds(self) -> float:
        """What the first population took longer."""
        return self._program.compile_seconds

    def __call__(self, weights: Weights, iteration: int, vectors: np.ndarray) -> np.ndarray:
        """Mean returns [P] of vectors [P, D]; all candidates see the same random numbers."""
        key, batch = jax.random.fold_in(self._key, iteration), self._batch(weights, vectors)
        returns, self._calls = self._program(key, batch), 1
        # candidates that have lost nothing yet are told apart by how rarely they do
        while self._wants_more(returns):
            own_key = jax.random.fold_in(key, returns.shape[1])
            returns = np.concatenate([returns, self._program(own_key, batch)], axis=1)
            self._calls += 1
        return np.mean(returns, axis=1)

    def _wants_more(self, returns: np.ndarray) -> bool:
        """Whether more rollouts than these [P, N] are worth their time."""
        count = returns.shape[1]
        takes = self._program.seconds * (self._calls + 1)
        if not self._avoids or count >= _MOST_AVOIDING or takes > _SLOW_SECONDS:
            return False
        return bool(np.mean(np.any(returns <= LOST, axis=1)) < _LOSING_SHARE)

    def compile(self, weights: Weights) -> None:
        """Plays a population, unless one of such parts was played: the first one compiles."""
        if not self.is_compiled(weights):
            self(weights, 0, np.tile(weights.start, (self.population, 1)))

    def is_compiled(self, weights: Weights) -> bool:
        """Whether there is a program for the parts that have an effect."""
        vectors = np.tile(weights.start, (self.population, 1))
        by_parts = self._by_parts
        return by_parts is None or by_parts.is_compiled(self._batch(weights, vectors))

    def _batch(self, weights: Weights, vectors: np.ndarray) -> Params:
        params = weights.batch(vectors)
        if self._by_parts is None:
            return params
        return {name: part for name, part in params.items() if name not in weights.idle}

    def best(self, weights: Weights, vectors: list[np.ndarray]) -> np.ndarray:
        """The vector [D] of the largest mean return in rollouts that no iteration has seen.

        They are the same at each call.
        """
        places = [number % len(vectors) for number in range(self.population)]
        batch = np.stack([vectors[place] for place in places])
        batches = min(_FINAL_BATCHES, math.ceil(_FINAL_ROLLOUTS / self._rollouts))
        seconds = self._program.seconds
        batches = 1 if seconds > _SLOW_SECONDS else batches
        while self._avoids and batches * self._rollouts < _MOST_AVOIDING:
            if (batches + 1) * seconds > _SLOW_SECONDS:
                break
            batches += 1
        params = self._batch(weights, batch)
        keys = [jax.random.fold_in(self._key, 10**6 + number) for number in range(batches)]
        fresh = np.concatenate([self._program(key, params) for key in keys], axis=1)
        means = np.mean(fresh, axis=1)[: len(vectors)]
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
    if wanted.judged and wanted.program_seconds > _LONGEST_SHARE * (deadline - clock()):
        logger.info("policies are played one by one: there is no time to compile a population's")
        each = OneByOne(planner, wanted.judged, wanted.program_seconds, clock, deadline)
        return PopulationReturns(each, Size(POLICIES, wanted.judged, 1), seed)
    size = fitting_size(planner)
    shared = weights_of(planner.feedback_plan.noop(seed), ["shared"])
    zeros = np.zeros((size.population, shared.start.size))
    avoids = planner.lose_on_error
    fewer = max(1, size.rollouts // _FEWER_AVOIDING) if avoids else 1
    rollouts_tried = {1} if wanted.deterministic else {size.rollouts, fewer}
    fewest, slow = _FEWEST_ITERATIONS, _TOO_SLOW_BY
    if avoids:
        fewest, slow = _FEWEST_AVOIDING, _TOO_SLOW_AVOIDING
    for rollouts in sorted(rollouts_tried, reverse=True):
        tried = size._replace(rollouts=rollouts)
        least = fewest * size.population * rollouts * wanted.rollout_seconds
        too_long = slow * wanted.share * (deadline - clock())
        if rollouts > min(rollouts_tried) and least > too_long:
            continue
        program = _compiled(planner, tried, clock, deadline)
        population = PopulationReturns(program, tried, seed, avoids and not wanted.deterministic)
        population(shared, 0, zeros)
        if size.side_by_side is None:
            population(shared, 0, zeros)  # the first call compiled
        logger.info("%d rollouts of %d take %.3g s", rollouts, size.population, population.seconds)
        search_seconds = wanted.share * (deadline - clock())
        # another program takes as long to compile: less of it than of the search it is for
        is_too_late = population.compile_seconds > search_seconds
        if population.seconds * fewest < search_seconds or is_too_late:
            break
    return population


def _compiled(planner: MDPOPlanner, size: Size, clock: Clock, deadline: float) -> Program:
    """What plays a population; compiled, until the deadline, when it is first called."""

    def make() -> Callable[[jax.Array, Params], np.ndarray]:
        returns = compile_exact_returns(planner, size.rollouts, size.side_by_side)
        return lambda key, params: np.asarray(returns(key, params), float)

    return ByParts(make, clock, deadline)
