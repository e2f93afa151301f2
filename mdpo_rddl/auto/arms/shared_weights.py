"""The arm that adapts the weights that all objects share, without a gradient."""

import numpy as np

from mdpo_rddl.auto.adapting import Adapting
from mdpo_rddl.auto.arena import Arena
from mdpo_rddl.auto.arms.base import ArenaArm
from mdpo_rddl.auto.search.cma import Adaptation, Sampling
from mdpo_rddl.auto.search.weights import Weights, simple_weights, weights_of
from mdpo_rddl.auto.state import State, joined

SHARED_WEIGHTS = "shared weights"
_SIGMA, _REFINING_SIGMA = 0.5, 0.1
# of the simple rule, and of all weights: what is begun with, and two adaptations
_VECTORS = 3


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
        # of the slice that goes on: what its adaptations began with and have found, per part
        self._simple: list[np.ndarray] = []
        self._every: list[np.ndarray] = []
        self._adapting = Adapting(arena, self._try)

    def state(self) -> State | None:
        """What the adaptations of the slice that goes on have found, and the one at work."""
        if not self._simple:
            return None
        tensors = {"simple": np.stack(self._simple)}
        if self._every:
            tensors["every"] = np.stack(self._every)
        state = State(tensors)
        latest = self._adapting.state()
        return state if latest is None else joined(state, latest.within("adaptation"))

    def restore(self, state: State) -> None:
        """Goes on with the slice."""
        arena = self._arena
        simple, every = simple_weights(arena.noop, arena.plan), weights_of(arena.noop, ["shared"])
        begun = list(state.array("simple", (None, simple.start.size)))
        refined = []
        if "every" in state.tensors:
            refined = list(state.array("every", (None, every.start.size)))
        if not 0 < len(begun) <= _VECTORS or len(refined) > _VECTORS:
            counts = f"{len(begun)} and {len(refined)}"
            raise ValueError(f"its adaptations are {counts}, and {_VECTORS} are the most of each")
        if "adaptation" in state.values:
            self._adapting.restore(state.part("adaptation"))
        self._simple, self._every = begun, refined if len(begun) == _VECTORS else []

    def _prepare(self) -> None:
        self._arena.compile_population()

    def _work(self, until: float) -> None:
        arena, population = self._arena, self._arena.population
        parent = arena.judge.latest(self._begins_with)
        params = arena.noop if parent is None else parent.params
        simple, every = simple_weights(arena.noop, arena.plan), weights_of(arena.noop, ["shared"])
        vectors = self._simple = self._simple or [simple_weights(params, arena.plan).start]
        for parts, start in ((4, vectors[0]), (3, simple.start))[len(vectors) - 1 :]:
            vectors.append(self._adapted(simple, start, _SIGMA, self._part(until, parts)))
        if not self._every:
            best_simple = simple.to_params(population.best(simple, vectors))
            self._every = [weights_of(best_simple, ["shared"]).start]
        vectors = self._every
        refining = (2, vectors[0], _REFINING_SIGMA), (1, every.start, _SIGMA)
        for parts, start, sigma in refining[len(vectors) - 1 :]:
            vectors.append(self._adapted(every, start, sigma, self._part(until, parts)))
        best = every.to_params(population.best(every, vectors))
        self._simple, self._every = [], []
        self._offer_child(parent, SHARED_WEIGHTS, best)

    def _part(self, until: float, parts: int) -> float:
        """The end of the first of so many equal parts of the time left."""
        now = self._clock()
        return now + (until - now) / parts

    def _adapted(
        self, weights: Weights, start: np.ndarray, sigma: float, until: float
    ) -> np.ndarray:
        # the candidates' generator refuses the seed 0
        sampling = Sampling(sigma, self._arena.population.population, self._arena.seed + 1)
        adaptation = Adaptation(start, sampling, self._clock)
        self._log.iterations += self._adapting.run(weights, adaptation, until)
        return adaptation.mean
