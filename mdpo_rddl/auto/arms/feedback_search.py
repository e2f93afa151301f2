"""The part of the recipe that needs no gradient: shared weights first, then each object's own."""

import logging
import time

import jax
import numpy as np

from mdpo_rddl.auto.arms.cma import SearchResult, search
from mdpo_rddl.auto.arms.weights import Weights, weights_of
from mdpo_rddl.auto.sizes import Size, fitting_size
from mdpo_rddl.planner.exact import compile_exact_returns
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.plans.feedback import Params

logger = logging.getLogger(__name__)

# a search of fewer iterations than that finds nothing: then one rollout has to do
_FEWEST_ITERATIONS = 100
_WIDE = 512
_SHARED_SIGMA, _REFINING_SIGMA = 0.5, 0.1
_MOST_OWN_WEIGHTS = 5000
_FINAL_BATCHES = 8
_SLOW_SECONDS = 0.5


class Earn:
    """What a population earns on the exact model.

    Attributes:
      population: candidates P of an iteration.
      seconds: that one iteration takes.
      compile_seconds: that the first took longer.
    """

    def __init__(self, planner: MDPOPlanner, size: Size, seed: int) -> None:
        """Compiles it when it is first called."""
        self.population, self.seconds = size.population, 0.0
        self.compile_seconds = 0.0
        self._returns = compile_exact_returns(planner, size.rollouts, size.side_by_side)
        self._key = jax.random.PRNGKey(seed)

    def __call__(self, weights: Weights, iteration: int, vectors: np.ndarray) -> np.ndarray:
        """Mean returns [P] of vectors [P, D]; all candidates see the same random numbers."""
        started = time.monotonic()
        key = jax.random.fold_in(self._key, iteration)
        returns = np.asarray(self._returns(key, weights.batch(vectors)), float)
        self.seconds = time.monotonic() - started
        return np.mean(returns, axis=1)


class FeedbackSearch:
    """Searches for the weights of a feedback policy.

    Attributes:
      evaluation_seconds: that the rollouts of one population take.
      compile_seconds: that compiling them took.
      shared_iterations, own_iterations: done so far.
    """

    def __init__(self, planner: MDPOPlanner, params: Params, seed: int, until: float) -> None:
        """Compiles.

        Args:
          planner: with a `FeedbackPlan`.
          params: of the policy that does nothing.
          seed: of the candidates and of the model.
          until: when the first search is to end, by `time.monotonic`.
        """
        self._planner, self._params, self._seed = planner, params, seed
        self._earn = _compile(planner, params, seed, until)
        self._simple = weights_of(params, ["shared"], _simple(planner))
        self._start = self._simple.start
        self.shared_iterations = self.own_iterations = 0

    @property
    def evaluation_seconds(self) -> float:
        """Of the last population."""
        return self._earn.seconds

    @property
    def compile_seconds(self) -> float:
        """Of the population's program."""
        return self._earn.compile_seconds

    def wide(self, until: float) -> Params:
        """The best of many random simple rules, from which `shared` goes on."""
        found, earned = _search_wide(self._earn, self._simple, until, self._seed)
        self._start = found[np.argmax(earned)]
        return self._simple.into(self._start)

    def shared(self, until: float) -> Params:
        """The policy with the best shared weights: first of a simple rule, then all of them."""
        earn, simple = self._earn, self._simple
        found = [self._start]
        for number, start in enumerate([self._start, simple.start]):
            found.append(self._adapt(simple, start, _SHARED_SIGMA, _share(until, 4 - number)))
        every = weights_of(self._params, ["shared"])
        refined = weights_of(simple.into(_best(earn, simple, found)), ["shared"])
        found = [refined.start]
        for parts, start, sigma in (
            (2, refined.start, _REFINING_SIGMA),
            (1, every.start, _SHARED_SIGMA),
        ):
            found.append(self._adapt(every, start, sigma, _share(until, parts)))
        return every.into(_best(earn, every, found))

    def around(self, params: Params, sigma: float, until: float) -> Params:
        """Searches around a policy for its shared and own weights; of too many, the shared."""
        weights = weights_of(params, ["shared", "own"])
        if weights.start.size > _MOST_OWN_WEIGHTS:
            weights = weights_of(params, ["shared"])
        result = _adapt(
            self._earn, weights, weights.start, sigma, until, self._seed, separable=True
        )
        self.own_iterations += result.iterations
        return weights.into(result.mean)

    def _adapt(self, weights: Weights, start: np.ndarray, sigma: float, until: float) -> np.ndarray:
        result = _adapt(self._earn, weights, start, sigma, until, self._seed)
        self.shared_iterations += result.iterations
        return result.mean


def _adapt(
    earn: Earn,
    weights: Weights,
    start: np.ndarray,
    sigma: float,
    until: float,
    seed: int,
    separable: bool = False,
) -> SearchResult:
    return search(
        lambda iteration, batch: earn(weights, iteration, batch),
        start,
        sigma=sigma,
        population=earn.population,
        until=until,
        seed=seed + 1,  # the candidates' generator refuses 0
        separable=separable,
    )


def _share(until: float, parts: int) -> float:
    """The end of the first of so many equal parts of the time left."""
    now = time.monotonic()
    return now + (until - now) / parts


def _simple(planner: MDPOPlanner) -> dict[str, list[bool]]:
    """Which shared weights a simple rule has: linear in the state, the same at all times."""
    feedback = planner.feedback_plan.feedback
    return {
        name: [not (feature.endswith("^2") or feature.startswith("cos(")) for feature in names]
        for name, names in ((n, feedback.names(n)) for n in feedback.action_shapes)
    }


def _search_wide(
    earn: Earn, weights: Weights, until: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Random vectors [N, D] and what they earn [N]: at least one population."""
    random = np.random.default_rng(seed)
    size = (earn.population, weights.start.size)
    wide: list[np.ndarray] = []
    earned: list[np.ndarray] = []
    while not wide or (len(wide) * earn.population < _WIDE and time.monotonic() < until):
        # most of the weights of a simple rule are zero
        scales = random.choice([0.0, 1.0, 3.0], size=size, p=[0.5, 0.3, 0.2])
        wide.append(random.normal(size=size) * scales * _SHARED_SIGMA)
        earned.append(earn(weights, 0, wide[-1]))
    returns = np.concatenate(earned)
    return np.concatenate(wide), np.where(np.isfinite(returns), returns, -np.inf)


def _compile(planner: MDPOPlanner, params: Params, seed: int, until: float) -> Earn:
    """With fewer rollouts where a search would have too few iterations."""
    size = fitting_size(planner)
    shared = weights_of(params, ["shared"])
    zeros = np.zeros((size.population, shared.start.size))
    for rollouts in sorted({size.rollouts, 1}, reverse=True):
        earn = Earn(planner, size._replace(rollouts=rollouts), seed)
        earn(shared, 0, zeros)
        if size.side_by_side is None:
            first = earn.seconds
            earn(shared, 0, zeros)  # the first call compiled
            earn.compile_seconds = first - earn.seconds
        logger.info("%d rollouts of %d take %.3g s", rollouts, size.population, earn.seconds)
        if earn.seconds * _FEWEST_ITERATIONS < until - time.monotonic():
            break
    return earn


def _best(earn: Earn, weights: Weights, found: list[np.ndarray]) -> np.ndarray:
    """The vector that earns most in fresh rollouts."""
    batch = np.stack([found[number % len(found)] for number in range(earn.population)])
    batches = 1 if earn.seconds > _SLOW_SECONDS else _FINAL_BATCHES
    fresh = [earn(weights, 10**6 + number, batch) for number in range(batches)]
    means = np.mean(fresh, axis=0)[: len(found)]
    return found[int(np.argmax(np.where(np.isfinite(means), means, -np.inf)))]
