"""One object's weights at a time, beside what all others do; a search without a gradient.

An adaptation of all objects' weights sees what suits one of them in the sum of all rewards, and
where each has several local optima, as a reservoir that keeps its water or lets it pass, it ends in
one of very many. In rollouts in common, in which all others' weights stay, a change to one object's
weights shows by itself; what gains on several objects is then tried together, as in the crossover
of `mdpo_rddl.auto.search.crossing`.
"""

import math
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from mdpo_rddl.auto.search.cma import Evaluate
from mdpo_rddl.auto.search.crossing import parts_of
from mdpo_rddl.auto.search.flat import Flat
from mdpo_rddl.planner.plans.feedback import Params

FEWEST_OBJECTS = 3
"""With fewer there is little to tell apart."""
# changes of an object in a round, and of all objects
_CHANGES, _MOST_CHANGES = 16, 512
# of the normal changes, drawn evenly by their logarithms
_SMALLEST, _LARGEST = 0.01, 1.0
# populations in rollouts of their own that tell whether changes gain together, and by how many
# standard errors
_FRESH, _ERRORS = 4, 2.0
# so many rounds in a row that gain less than this share of what all have gained are the last
_STALLED_ROUNDS, _LEAST_SHARE = 2, 0.05


def objects_of(rddl: Any, params: Params) -> np.ndarray:
    """Whose each of the shared and own weights is, as `weights_of` has them, -1 if shared [D].

    Args:
      rddl: pyRDDLGym's lifted model.
      params: of one feedback policy.
    """
    parts = enumerate(parts_of(rddl))
    numbers = {entry: number for number, part in parts for entry in part}

    def labelled(action: str, values: Any) -> np.ndarray:
        labels = np.zeros(np.shape(values), int)
        for name, place in numbers:
            if name == action:
                labels[... if place is None else place] = numbers[name, place]
        return labels

    shared = jax.tree.map(lambda weights: np.full(np.shape(weights), -1), params["shared"])
    own = {
        action: {entry: labelled(action, values) for entry, values in entries.items()}
        for action, entries in params["own"].items()
    }
    return Flat.vector({"shared": shared, "own": own})


class ObjectWise:
    """Rounds of random changes, each to the weights of one object.

    Attributes:
      best: the weights so far [D].
      gained: by these, in rollouts that did not choose them.
      iterations: populations so far.
    """

    def __init__(self, start: np.ndarray, objects: np.ndarray, population: int, seed: int) -> None:
        """Evaluates nothing yet.

        Args:
          start: the weights to begin with [D].
          objects: whose each weight is, from 0; those of -1 stay as they are [D].
          population: policies of an evaluation P.
          seed: of the changes.
        """
        self.best, self.gained, self.iterations = np.asarray(start, float), 0.0, 0
        self._objects, self._count = objects, int(np.max(objects, initial=-1)) + 1
        self._population = population
        self._random = np.random.default_rng(seed)
        self._stalled = 0

    @property
    def round_populations(self) -> int:
        """Populations of a round, at most."""
        changes = min(_MOST_CHANGES, _CHANGES * self._count)
        return math.ceil(changes / (self._population - 1)) + _FRESH

    def run(self, evaluate: Evaluate, has_time: Callable[[], bool]) -> None:
        """Makes rounds until they gain little or the time is over.

        Args:
          evaluate: see `Evaluate`; of one iteration all see the same random numbers.
          has_time: whether to go on.
        """
        while has_time() and self._stalled < _STALLED_ROUNDS:
            gained = self._round(evaluate, has_time)
            self.gained += gained
            is_little = gained <= _LEAST_SHARE * self.gained
            self._stalled = self._stalled + 1 if is_little else 0

    def _round(self, evaluate: Evaluate, has_time: Callable[[], bool]) -> float:
        """What a round has gained, in fresh rollouts."""
        objects, changes = self._changes()
        gains = self._gains(evaluate, changes, has_time)
        objects, changes = objects[: len(gains)], changes[: len(gains)]
        order = np.argsort(-gains, kind="stable")
        _, first = np.unique(objects[order], return_index=True)
        # of each object the change that gains most, those that gain most first
        best = [place for place in order[np.sort(first)] if gains[place] > 0.0]
        if not best:
            return 0.0
        together = [self._made(objects, changes, best[:count]) for count in _counts(len(best))]
        means, errors = self._tested(evaluate, np.stack(together))
        chosen = int(np.argmax(means))
        if not means[chosen] > _ERRORS * errors[chosen]:
            return 0.0
        self.best = together[chosen]
        return float(means[chosen])

    def _changes(self) -> tuple[np.ndarray, np.ndarray]:
        """Objects [C], and the weights with a change to those of each [C, D]."""
        chosen = self._random.permutation(self._count)[: _MOST_CHANGES // _CHANGES]
        objects = np.repeat(chosen, _CHANGES)
        low, high = np.log([_SMALLEST, _LARGEST])
        sigmas = np.exp(self._random.uniform(low, high, (len(objects), 1)))
        moves = sigmas * self._random.normal(size=(len(objects), self.best.size))
        return objects, np.where(self._objects == objects[:, None], self.best + moves, self.best)

    def _gains(
        self, evaluate: Evaluate, changes: np.ndarray, has_time: Callable[[], bool]
    ) -> np.ndarray:
        """What changes return more than the best weights, of as many as there was time for."""
        found: list[np.ndarray] = []
        number, size = self.iterations, self._population - 1
        for start in range(0, len(changes), size):
            if not has_time():
                break
            found.append(self._compared(evaluate, number, changes[start : start + size]))
        return np.concatenate(found) if found else np.zeros(0)

    def _tested(self, evaluate: Evaluate, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean gains in fresh rollouts, and their standard errors."""
        tests = [self._compared(evaluate, self.iterations, vectors) for _ in range(_FRESH)]
        return np.mean(tests, axis=0), np.std(tests, axis=0, ddof=1) / math.sqrt(_FRESH)

    def _compared(self, evaluate: Evaluate, number: int, vectors: np.ndarray) -> np.ndarray:
        """What weights [n, D] return more than the best so far; less, if that is no number."""
        rest = np.repeat(self.best[np.newaxis], self._population - len(vectors), axis=0)
        returns = np.asarray(evaluate(number, np.concatenate([vectors, rest])), float)
        self.iterations += 1
        gains = returns[: len(vectors)] - returns[-1]
        return np.where(np.isfinite(gains), gains, -math.inf)

    def _made(self, objects: np.ndarray, changes: np.ndarray, places: list[int]) -> np.ndarray:
        """The best weights with these changes."""
        made = self.best.copy()
        for place in places:
            own = self._objects == objects[place]
            made[own] = changes[place, own]
        return made


def _counts(gaining: int) -> list[int]:
    """How many of the changes that gain are tried together."""
    return sorted({1, math.ceil(gaining / 4), math.ceil(gaining / 2), gaining})
