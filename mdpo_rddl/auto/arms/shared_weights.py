"""The arm that adapts the weights that all objects share, without a gradient."""

import numpy as np

from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arms.base import ArenaArm
from mdpo_rddl.auto.search.cma import Adaptation, Sampling
from mdpo_rddl.auto.search.weights import Weights, simple_weights, weights_of

SHARED_WEIGHTS = "shared weights"
_SIGMA, _REFINING_SIGMA = 0.5, 0.1


class SharedWeightsArm(ArenaArm):
    """Adapts a simple rule first, then all shared weights.

    A slice has four adaptations: of the simple rule from the one that it begins with and from
    the no-op; of all weights from the better one of them, and from the no-op.
    """

    def __init__(self, arena: Arena, begins_with: str) -> None:
        """Compiles nothing yet.

        Args:
          arena: what all arms have in common.
          begins_with: label of a candidate that is a rule; the no-op if there is none.
        """
        super().__init__("shared weights", arena)
        self._begins_with = begins_with

    def _prepare(self) -> None:
        self._arena.compile_population()

    def _work(self, until: float) -> None:
        arena, population = self._arena, self._arena.population
        parent = arena.judge.latest(self._begins_with)
        params = arena.noop if parent is None else parent.params
        begun = simple_weights(params, arena.plan).start
        simple, every = simple_weights(arena.noop, arena.plan), weights_of(arena.noop, ["shared"])
        vectors = [begun]
        for parts, start in ((4, begun), (3, simple.start)):
            vectors.append(self._adapted(simple, start, _SIGMA, self._part(until, parts)))
        best_simple = simple.to_params(population.best(simple, vectors))
        refined = weights_of(best_simple, ["shared"]).start
        vectors = [refined]
        for parts, start, sigma in ((2, refined, _REFINING_SIGMA), (1, every.start, _SIGMA)):
            vectors.append(self._adapted(every, start, sigma, self._part(until, parts)))
        best = every.to_params(population.best(every, vectors))
        self._offer_child(parent, SHARED_WEIGHTS, best)

    def _part(self, until: float, parts: int) -> float:
        """The end of the first of so many equal parts of the time left."""
        now = self._clock()
        return now + (until - now) / parts

    def _adapted(
        self, weights: Weights, start: np.ndarray, sigma: float, until: float
    ) -> np.ndarray:
        population = self._arena.population
        # the candidates' generator refuses the seed 0
        sampling = Sampling(sigma, population.population, self._arena.seed + 1)
        adaptation = Adaptation(start, sampling, self._clock)
        adaptation.run(lambda number, vectors: population(weights, number, vectors), until)
        self._log.iterations += adaptation.iterations
        return adaptation.mean
