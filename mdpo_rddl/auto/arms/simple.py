"""The arm of policies that need no search: the no-op, the best constant and random rules."""

from enum import IntEnum

import numpy as np

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms.base import ArenaArm
from mdpo_rddl.auto.common.candidate import NOOP
from mdpo_rddl.auto.common.gains import return_to_beat
from mdpo_rddl.auto.search.population import PopulationReturns
from mdpo_rddl.auto.search.rules import Drawing, random_rules
from mdpo_rddl.auto.search.weights import Weights, simple_weights

SIMPLE = "constants and rules"
CONSTANT, RANDOM_RULE = "constant", "random rule"


class Rules(IntEnum):
    """Parts of a race in which rules are drawn, each with random numbers of its own."""

    FEW = 0
    MANY = 1


_COUNTS = {Rules.FEW: 2048, Rules.MANY: 32_768}


class SimpleArm(ArenaArm):
    """Offers the no-op and the best constant, and random rules where a part is for these.

    Where a reward comes only after many right actions, few rules are paid for what they do, and
    changing one that is not leads nowhere: more of them are drawn later.

    Attributes:
      rules: which of them the next slice draws; None if it is for the others.
      paid_share: of the rules drawn last, those that return more than the no-op; None before.
    """

    def __init__(self, arena: Arena) -> None:
        """Compiles nothing yet."""
        super().__init__(SIMPLE, arena)
        self.rules: Rules | None = None
        self.paid_share: float | None = None

    def _work(self, until: float) -> None:
        arena = self._arena
        rules = simple_weights(arena.noop, arena.plan)
        if self.rules is None:
            self._offer(arena.candidate(self.name, NOOP, arena.noop))
            self._offer(arena.candidate(self.name, CONSTANT, arena.constant))
            return
        started = self._clock()
        arena.compile_population()
        compile_seconds = self._clock() - started
        self._log.compile_seconds += compile_seconds
        # what is compiled serves all searches: the time for it is not taken from the rules
        until = min(until + compile_seconds, arena.deadline)
        found = self._random_rules(arena.population, rules, self.rules, until)
        best = arena.population.best(rules, found)
        self._offer(arena.candidate(self.name, RANDOM_RULE, rules.to_params(best)))

    def _random_rules(
        self, population: PopulationReturns, rules: Weights, which: Rules, until: float
    ) -> list[np.ndarray]:
        """Of many vectors [D], those of the largest returns: at least one population is drawn."""
        random = np.random.default_rng((self._arena.seed, int(which)))
        to_beat = return_to_beat(self._arena.noop_return.mean, 0.0)
        drawing = Drawing(_COUNTS[which], until, self._clock, to_beat)
        kept, drawn, self.paid_share = random_rules(population, rules, random, drawing)
        self._log.iterations += drawn
        return [rule.vector for rule in kept]
