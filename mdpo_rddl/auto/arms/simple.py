"""The arm of policies that need no search: the no-op, the best constant and random rules."""

import numpy as np

from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arms.base import ArenaArm
from mdpo_rddl.auto.search.population import PopulationReturns
from mdpo_rddl.auto.search.weights import Weights, simple_weights

SIMPLE = "constants and rules"
NOOP, CONSTANT, RANDOM_RULE = "no-op", "constant", "random rule"
_RULES = 512
_SIGMA = 0.5


class SimpleArm(ArenaArm):
    """Offers the no-op and the best constant in its first slice, a random rule in the others."""

    def __init__(self, arena: Arena) -> None:
        """Compiles nothing yet."""
        super().__init__(SIMPLE, arena)
        self._random = np.random.default_rng(arena.seed)

    def _work(self, until: float) -> None:
        arena = self._arena
        if self._log.slices == 1:
            self._offer(arena.candidate(self.name, NOOP, arena.noop))
            self._offer(arena.candidate(self.name, CONSTANT, arena.constant))
            return
        started = self._clock()
        arena.compile_population()
        self._log.compile_seconds += self._clock() - started
        rules = simple_weights(arena.noop, arena.plan)
        vector = self._best_random(arena.population, rules, until)
        self._offer(arena.candidate(self.name, RANDOM_RULE, rules.to_params(vector)))

    def _best_random(
        self, population: PopulationReturns, rules: Weights, until: float
    ) -> np.ndarray:
        """The vector [D] of the largest return of many: at least one population."""
        size = (population.population, rules.start.size)
        vectors: list[np.ndarray] = []
        returns: list[np.ndarray] = []
        while not vectors or (
            len(vectors) * population.population < _RULES and self._clock() < until
        ):
            # most of the weights of a simple rule are zero
            scales = self._random.choice([0.0, 1.0, 3.0], size=size, p=[0.5, 0.3, 0.2])
            vectors.append(self._random.normal(size=size) * scales * _SIGMA)
            returns.append(population(rules, 0, vectors[-1]))
            self._log.iterations += 1
        means = np.concatenate(returns)
        means = np.where(np.isfinite(means), means, -np.inf)
        return np.asarray(np.concatenate(vectors)[np.argmax(means)])
