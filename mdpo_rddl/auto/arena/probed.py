"""Rules that are found by what has played constants, where the judge's program comes too late."""

import logging
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.sizes import Size
from mdpo_rddl.auto.common.timing import Clock
from mdpo_rddl.auto.probing.constants import Constants
from mdpo_rddl.auto.search.cma import Adaptation, Sampling
from mdpo_rddl.auto.search.population import PopulationReturns
from mdpo_rddl.auto.search.rules import REFINING_SIGMA, RULE_SIGMA, Drawing, random_rules
from mdpo_rddl.auto.search.weights import Weights, weights_of
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.plans.feedback import Params
from mdpo_rddl.problem.evaluation import mean_and_error

logger = logging.getLogger(__name__)

# rules of a batch, and batches, with which a search finds something
_FEWEST_RULES, _FEWEST_BATCHES = 8, 8
# of the time: for random rules before the best of them is adapted; of all of it, for batches that
# tell which is better, of so many at most and by random numbers of their own
_RANDOM_SHARE, _FRESH_SHARE, _FRESH_BATCHES, _FRESH = 0.5, 0.3, 32, 10**6
# of what its adaptation has gained: a rule that gains less in a quarter of it is left
_LEAST_GAIN = 1e-4
_TOLD = "%d batches of %d rules by the program of the constants, %d and %d more adapt the best one"


@dataclass(frozen=True, eq=False)
class Probed:
    """What has played the constants of a probing, which can play rules as well.

    Attributes:
      config: of its planner, without scales.
      plays: plays batches of policies; its program is compiled.
    """

    config: PlannerConfig
    plays: Constants

    def has_time(self, until: float, clock: Clock) -> bool:
        """Whether a search among rules is possible, by a clock, until then."""
        plays = self.plays
        least = _FEWEST_BATCHES * plays.seconds
        return plays.size.at_once >= _FEWEST_RULES and until - clock() > least

    def best_rule(
        self,
        named: tuple[str, str],
        seed: int,
        until: float,
        clock: Clock,
        begin: Params | None = None,
    ) -> Candidate:
        """The best of random rules, or what its adaptation has led to.

        Args:
          named: arm and label of the candidate.
          seed: of the rules and of their rollouts.
          until: when to end, by the clock; there must be time.
          clock: what is asked for the time.
          begin: parameters of a rule to adapt in place of random ones.

        Returns:
          A candidate of its own planner, with mean and error in fresh rollouts.
        """
        plays = self.plays
        size = Size(plays.size.at_once, plays.size.rollouts, None)
        population = PopulationReturns(plays, size, seed)
        fresh = min(_FRESH_SHARE * (until - clock()), _FRESH_BATCHES * plays.seconds)
        search_until = until - max(fresh, 3.0 * plays.seconds)
        weights = weights_of(begin or plays.planner.feedback_plan.noop(seed), ["shared"])
        if begin is None:
            found = self._searched(population, seed, search_until, clock)
        else:
            end = _Adapting(population, seed, search_until, clock)(weights, weights.start, True)
            found = [weights.start, end.mean]
        batch = np.stack([found[number % len(found)] for number in range(size.population)])
        means: list[np.ndarray] = []
        while len(means) < 2 or (len(means) < _FRESH_BATCHES and clock() + plays.seconds < until):
            means.append(population(weights, _FRESH + len(means), batch)[: len(found)])
        told_means = np.mean(means, axis=0)
        best = int(np.argmax(np.where(np.isfinite(told_means), told_means, -np.inf)))
        mean, error = mean_and_error(np.array(means)[:, best])
        params = weights.to_params(found[best])
        return Candidate(*named, self.config, plays.planner, params, mean=mean, error=error)

    def _searched(
        self, population: PopulationReturns, seed: int, until: float, clock: Clock
    ) -> list[np.ndarray]:
        """The best random rule, what its adaptation ends with, and once more with small deviations.

        An adaptation ends where it gains no more.
        """
        most = population.population
        weights = weights_of(self.plays.planner.feedback_plan.noop(seed), ["shared"])
        random_until = clock() + _RANDOM_SHARE * (until - clock())
        drawing = Drawing(until=random_until, clock=clock)
        drawn = random_rules(population, weights, np.random.default_rng([seed, most]), drawing)
        start = drawn.kept[0].vector
        adapted = _Adapting(population, seed, until, clock)
        rule = adapted(weights, start)
        refined = adapted(weights, rule.mean, refines=True)
        logger.info(_TOLD, drawn.populations, most, rule.iterations, refined.iterations)
        return [start, rule.mean, refined.mean]


class _Adapting(NamedTuple):
    """Adapts vectors of weights until they gain no more, or the time is over."""

    population: PopulationReturns
    seed: int
    until: float
    clock: Clock

    def __call__(self, weights: Weights, begin: np.ndarray, refines: bool = False) -> Adaptation:
        sigma = REFINING_SIGMA if refines else RULE_SIGMA
        size = self.population.population
        sampling = Sampling(sigma, size, self.seed + 1, least_gain=_LEAST_GAIN)
        adaptation = Adaptation(begin, sampling, self.clock)
        adaptation.run(partial(self.population, weights), self.until)
        return adaptation
