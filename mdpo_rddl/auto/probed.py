"""Rules that are found by what has played constants, where the judge's program comes too late."""

import logging
from dataclasses import dataclass
from functools import partial

import numpy as np

from mdpo_rddl.auto.candidate import Candidate
from mdpo_rddl.auto.constants import Constants
from mdpo_rddl.auto.search.cma import Adaptation, Sampling
from mdpo_rddl.auto.search.population import PopulationReturns
from mdpo_rddl.auto.search.rules import RULE_SIGMA, Drawing, random_rules
from mdpo_rddl.auto.search.weights import simple_weights
from mdpo_rddl.auto.sizes import Size
from mdpo_rddl.auto.timing import Clock
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.problem.evaluation import mean_and_error

logger = logging.getLogger(__name__)

# rules of a batch, and batches, with which a search finds something
_FEWEST_RULES, _FEWEST_BATCHES = 8, 8
# of the time: for random rules before the best of them is adapted; of all of it, for batches that
# tell which is better, of so many at most and by random numbers of their own
_RANDOM_SHARE, _FRESH_SHARE, _FRESH_BATCHES, _FRESH = 0.5, 0.3, 32, 10**6
_TOLD = "%d batches of %d rules by the program of the constants, %d more adapt the best one"


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

    def best_rule(self, arm: str, label: str, seed: int, until: float, clock: Clock) -> Candidate:
        """The best of random rules, or what its adaptation has led to.

        Args:
          arm, label: of the candidate.
          seed: of the rules and of their rollouts.
          until: when to end, by the clock; there must be time.
          clock: what is asked for the time.

        Returns:
          A candidate of its own planner, with mean and error in fresh rollouts.
        """
        plays = self.plays
        plan = plays.planner.feedback_plan
        weights = simple_weights(plan.noop(seed), plan)
        size = Size(plays.size.at_once, plays.size.rollouts, None)
        population = PopulationReturns(plays, size, seed)
        fresh = min(_FRESH_SHARE * (until - clock()), _FRESH_BATCHES * plays.seconds)
        search_until = until - max(fresh, 3.0 * plays.seconds)
        random_until = clock() + _RANDOM_SHARE * (search_until - clock())
        random = np.random.default_rng([seed, size.population])
        drawn = random_rules(population, weights, random, Drawing(until=random_until, clock=clock))
        start = drawn.kept[0].vector
        adaptation = Adaptation(start, Sampling(RULE_SIGMA, size.population, seed + 1), clock)
        adaptation.run(partial(population, weights), search_until)
        logger.info(_TOLD, drawn.populations, size.population, adaptation.iterations)
        both = [start, adaptation.mean]
        batch = np.stack([both[number % 2] for number in range(size.population)])
        means: list[np.ndarray] = []
        while len(means) < 2 or (len(means) < _FRESH_BATCHES and clock() + plays.seconds < until):
            means.append(population(weights, _FRESH + len(means), batch)[:2])
        told_means = np.mean(means, axis=0)
        best = int(np.argmax(np.where(np.isfinite(told_means), told_means, -np.inf)))
        mean, error = mean_and_error(np.array(means)[:, best])
        params = weights.to_params(both[best])
        return Candidate(arm, label, self.config, plays.planner, params, mean=mean, error=error)
