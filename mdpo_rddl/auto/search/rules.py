"""Random rules: vectors of weights, most of them zero, of which the best are kept."""

import math
import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.auto.search.population import PopulationReturns
from mdpo_rddl.auto.search.weights import Weights

RULE_SIGMA = 0.5
"""Deviation of a weight that is not zero."""
REFINING_SIGMA = 0.1
"""Deviation of a weight where a rule that was found goes on with all weights."""
FEW_RULES = 512
"""Rules that say where a search may begin."""
# every so many rules have all their weights times a power of ten, of an exponent in between: where
# a state is to be held, probing's constants have seen it far away, and its unit is too large
_STRONG, _EXPONENTS = 4, (0.5, 2.0)


class Rule(NamedTuple):
    """A vector of weights [D] and its mean return in few rollouts."""

    mean: float
    vector: np.ndarray


@dataclass(frozen=True)
class Drawing:
    """How many rules are drawn.

    Attributes:
      count: of all rules; whole populations are drawn, and one at least.
      until: when to end, by the clock.
      clock: what is asked for the time.
      to_beat: a return of which is told how many rules exceed it.
    """

    count: int = FEW_RULES
    until: float = math.inf
    clock: Clock = time.monotonic
    to_beat: float = math.inf


class Drawn(NamedTuple):
    """What was drawn.

    Attributes:
      kept: a population at most, the best one first.
      populations: how many were drawn.
      paid_share: of all rules, those that return more than `Drawing.to_beat`.
    """

    kept: list[Rule]
    populations: int
    paid_share: float


def random_rules(
    population: PopulationReturns, rules: Weights, random: np.random.Generator, drawing: Drawing
) -> Drawn:
    """The best of random rules.

    Args:
      population: plays them, all in the same rollouts.
      rules: what the vectors stand for.
      random: generator, which moves on.
      drawing: how many.
    """
    size = (population.population, rules.start.size)
    drawn, paid, kept = 0, 0, list[Rule]()
    while not drawn or (
        drawn * population.population < drawing.count and drawing.clock() < drawing.until
    ):
        # most of the weights of a simple rule are zero
        scales = random.choice([0.0, 1.0, 3.0], size=size, p=[0.5, 0.3, 0.2])
        vectors = random.normal(size=size) * scales * RULE_SIGMA
        strong = vectors[::_STRONG]
        strong *= 10.0 ** random.uniform(*_EXPONENTS, size=(len(strong), 1))
        means = population(rules, 0, vectors)
        means = np.where(np.isfinite(means), means, -np.inf)
        kept += map(Rule, means.tolist(), vectors)
        kept = sorted(kept, key=lambda rule: -rule.mean)[: population.population]
        drawn += 1
        paid += int((means > drawing.to_beat).sum())
    return Drawn(kept, drawn, paid / (drawn * population.population))
