"""The arm that adapts the weights that all objects share, without a gradient."""

from enum import Enum, auto

import numpy as np

from mdpo_rddl.auto.arena.adapting import Adapting
from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.base import FIRST_SLICES, ArenaArm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.search.cma import FEWEST_TO_STALL, Adaptation, Sampling
from mdpo_rddl.auto.search.rules import FEW_RULES, REFINING_SIGMA, Drawing, random_rules
from mdpo_rddl.auto.search.weights import Weights, simple_weights, weights_of
from mdpo_rddl.errors import Cancelled, note_heard
from mdpo_rddl.planner.plans.feedback import Params

SHARED_WEIGHTS = "shared weights"
_SIGMA = 0.5
# of all weights, where they begin at a random rule
_RANDOM_SIGMA = 0.2
# of a simple rule: what was gained by the quarter of its iterations before it is left
_LEAST_GAIN = 0.01
# of a slice: what the simple rules begin with, and their adaptations
_MOST_SIMPLE = 16
# of generators of rules, beside the race's seed: others are the first rules'
_RESTARTS, _EVERY = 2, 3
# of so many parts of an adaptation's time one at most is for the rules at which it begins
_DRAWING = 3


class _Start(Enum):
    """Where adaptations of all weights begin."""

    RULE = auto()
    RANDOM = auto()
    NOOP = auto()


_STARTS = (_Start.RULE, _Start.RANDOM, _Start.NOOP)


class SharedWeightsArm(ArenaArm):
    """Adapts simple rules first, then all shared weights.

    An adaptation ends in one of many local optima. So a simple rule is left where it gains no
    more, and others begin at the best of random rules each, for half of a slice; those of the
    first slice come after a given rule and the no-op. Then all weights are adapted, from the best
    rule, from the best of random rules that have all weights, and from the no-op; in later slices,
    unless a simple rule is better than all before, from such a random rule alone.
    """

    def __init__(self, arena: Arena, begins_with: str) -> None:
        """Compiles nothing yet.

        Args:
          arena: what all arms have in common.
          begins_with: label of a candidate that is a rule; the no-op if there is none.
        """
        super().__init__(SHARED_WEIGHTS, arena)
        self._begins_with = begins_with
        # of the slice that goes on: what its adaptations began with and have found, per part
        self._simple: list[np.ndarray] = []
        self._every: list[np.ndarray] = []
        # slices that have ended, rules that were adapted beside the first ones, and slices that
        # were too short for one
        self._ended = self._others = self._skipped = 0
        # whether all weights begin at the best simple rule and at the no-op, too
        self._begins_at_rule = True
        # the best of all weights in slices before
        self._known: np.ndarray | None = None
        self._adapting = Adapting(arena)

    def _prepare(self) -> None:
        self._arena.compile_population()

    def _work(self, until: float) -> None:
        """Adapts rules, then all weights.

        Raises:
          Cancelled: if interrupted; the best of what the slice has found till then is offered.
        """
        try:
            self._search(until)
        except (KeyboardInterrupt, Cancelled) as stop:
            note_heard(stop)
            self._offer_begun()
            raise

    def _offer_begun(self) -> None:
        """Hands in the best of what an interrupted slice has begun."""
        arena, found = self._arena, self._adapting.found
        if self._every:
            weights, vectors = self._all_weights(arena.noop), self._every
        else:
            weights, vectors = simple_weights(arena.noop, arena.plan), self._simple
        vectors = vectors if found is None else [*vectors, found]
        # the first one is what the slice began with
        if len(vectors) > 1:
            self._offer_best(weights, vectors, None)

    def _offer_best(
        self, weights: Weights, vectors: list[np.ndarray], parent: Candidate | None
    ) -> np.ndarray:
        """Hands in the best, unless it was there before the slice; gives it back.

        Args:
          weights: what the vectors stand for.
          vectors: what the slice began with, and what it has found.
          parent: whose rule the first two of them come from; the others come from nobody.
        """
        best = self._arena.population.best(weights, vectors)
        parent = parent if any(best is vector for vector in vectors[:2]) else None
        if not self._every or self._begins_at_rule or best is not vectors[0]:
            self._offer_child(parent, SHARED_WEIGHTS, weights.to_params(best))
        return best

    def _search(self, until: float) -> None:
        arena = self._arena
        parent = arena.judge.latest(self._begins_with)
        simple, every = simple_weights(arena.noop, arena.plan), self._all_weights(arena.noop)
        if not self._begin(simple, parent, until):
            return
        vectors = self._every
        starts = _STARTS if self._begins_at_rule else (_Start.RANDOM,)
        for number, place in enumerate(starts):
            end = self._part(until, len(starts) - number)
            start, sigma = self._start(place, every, end)
            vectors.append(self._adapted(every, start, self._sampling(sigma), end))
        self._known = self._offer_best(every, vectors, None if self._ended else parent)
        self._every = []
        self._ended += 1

    def _begin(self, simple: Weights, parent: Candidate | None, until: float) -> bool:
        """Adapts simple rules, after which all weights begin; False if there is no time for one."""
        if not self._ended:
            rule: np.ndarray | None = self._first_rule(simple, parent, until)
        else:
            begun = self._others
            rule = self._other_rule(simple, until)
            if rule is None and self._others == begun:
                # the first slices in the rounds are shorter
                self._skipped += 1
                self.is_exhausted = self._skipped > FIRST_SLICES
                self._ended += 1
                return False
        self._begins_at_rule = rule is not None
        start = self._known if rule is None else self._all_weights(simple.to_params(rule)).start
        self._every = [self._all_weights(self._arena.noop).start if start is None else start]
        return True

    @staticmethod
    def _all_weights(params: Params) -> Weights:
        return weights_of(params, ["shared"])

    def _start(self, start: _Start, every: Weights, until: float) -> tuple[np.ndarray, float]:
        """Where an adaptation of all weights begins, and its first deviation."""
        if start is _Start.RULE:
            return self._every[0], REFINING_SIGMA
        # nothing is drawn too late
        if start is _Start.NOOP or self._clock() >= until:
            return every.start, _SIGMA
        random = np.random.default_rng((self._arena.seed, _EVERY, 1 + self._ended))
        drawing = Drawing(until=self._part(until, _DRAWING), clock=self._clock)
        drawn = random_rules(self._arena.population, every, random, drawing)
        self._log.iterations += drawn.populations
        return drawn.kept[0].vector, _RANDOM_SIGMA

    def _first_rule(self, simple: Weights, parent: Candidate | None, until: float) -> np.ndarray:
        """The best of rules that were adapted in the first half of the first slice."""
        params = self._arena.noop if parent is None else parent.params
        first = simple_weights(params, self._arena.plan).start
        self._simple, half = [first], self._part(until, 2)
        for start, end in ((first, self._part(half, 2)), (simple.start, half)):
            adapted = self._adapted(simple, start, self._sampling(_SIGMA, _LEAST_GAIN), end)
            self._simple.append(adapted)
        self._adapt_others(simple, half)
        return self._best_of(simple)

    def _other_rule(self, simple: Weights, until: float) -> np.ndarray | None:
        """One that is better than all before; None if none was found in the slice."""
        before, begun = self._simple[0], self._others
        for end in (self._part(until, 2), until):
            self._adapt_others(simple, end)
            if self._others > begun:
                break
        best = self._best_of(simple)
        return None if best is before else best

    def _best_of(self, simple: Weights) -> np.ndarray:
        """The best rule so far, which alone is kept."""
        if len(self._simple) > 1:
            self._simple = [self._arena.population.best(simple, self._simple)]
        return self._simple[0]

    def _adapt_others(self, simple: Weights, until: float) -> None:
        """Adapts the best of random rules each, as long as there is time for one more."""
        vectors, population = self._simple, self._arena.population
        least = population.seconds * (FEWEST_TO_STALL + FEW_RULES // population.population)
        while len(vectors) < min(_MOST_SIMPLE, population.population):
            if until - self._clock() < least:
                break
            random = np.random.default_rng((self._arena.seed, _RESTARTS, self._others))
            drawing = Drawing(until=until, clock=self._clock)
            drawn = random_rules(population, simple, random, drawing)
            self._log.iterations += drawn.populations
            sampling = self._sampling(_SIGMA, _LEAST_GAIN, 1 + self._others)
            vectors.append(self._adapted(simple, drawn.kept[0].vector, sampling, until))
            self._others += 1

    def _part(self, until: float, parts: int) -> float:
        """The end of the first of so many equal parts of the time left."""
        now = self._clock()
        return now + (until - now) / parts

    def _sampling(self, sigma: float, least_gain: float = 0.0, number: int = 0) -> Sampling:
        # the candidates' generator refuses the seed 0
        seed = self._arena.seed + 1 + number
        return Sampling(sigma, self._arena.population.population, seed, least_gain=least_gain)

    def _adapted(
        self, weights: Weights, start: np.ndarray, sampling: Sampling, until: float
    ) -> np.ndarray:
        adaptation = Adaptation(start, sampling, self._clock)
        self._log.iterations += self._adapting.run(weights, adaptation, until)
        return adaptation.mean
