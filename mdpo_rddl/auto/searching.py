"""The part of the recipe that needs no gradient: shared weights first, then each object's own."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

import jax
import numpy as np

from mdpo_rddl.auto.search import SearchResult, search
from mdpo_rddl.auto.sizes import Size, fitting_size
from mdpo_rddl.auto.weights import Weights, weights_of
from mdpo_rddl.feedback import Params
from mdpo_rddl.jaxplan.exact import compile_exact_returns
from mdpo_rddl.jaxplan.planner import MDPOPlanner

logger = logging.getLogger(__name__)

# a search of fewer iterations than that finds nothing: then one rollout has to do
_FEWEST_ITERATIONS = 100
_WIDE = 512
_SHARED_SIGMA, _REFINING_SIGMA, _OWN_SIGMA = 0.5, 0.1, 0.03
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


@dataclass(frozen=True)
class Searched:
    """What the search found.

    Attributes:
      shared: parameters after the search for the shared weights.
      params: after the search for each object's own, which starts there.
      shared_iterations, own_iterations: done.
      evaluation_seconds: that the rollouts of one population took.
      compile_seconds: that compiling them took.
      polish: (policy, sigma, until, seed) -> a policy searched for around it.
    """

    shared: Params
    params: Params
    shared_iterations: int
    own_iterations: int
    evaluation_seconds: float
    compile_seconds: float
    polish: Callable[[Params, float, float, int], Params]


def search_feedback(
    planner: MDPOPlanner, params: Params, *, seed: int, shared_until: float, own_until: float
) -> Searched:
    """Searches for the weights of a feedback policy.

    Args:
      planner: with a `FeedbackPlan`.
      params: of the policy that does nothing.
      seed: of the candidates and of the model.
      shared_until, own_until: when each part ends, by `time.monotonic`.
    """
    earn = _compile(planner, params, seed, shared_until)
    simple = weights_of(params, ["shared"], _simple(planner))
    wide, earned = _search_wide(earn, simple, _share(shared_until, 4), seed)
    found, iterations = [wide[np.argmax(earned)]], 0
    for number, start in enumerate([found[0], simple.start]):
        result = _adapt(earn, simple, start, _SHARED_SIGMA, _share(shared_until, 4 - number), seed)
        found.append(result.mean)
        iterations += result.iterations
    every = weights_of(params, ["shared"])
    refined = weights_of(simple.into(_best(earn, simple, found)), ["shared"])
    found = [refined.start]
    for parts, start, sigma in (
        (2, refined.start, _REFINING_SIGMA),
        (1, every.start, _SHARED_SIGMA),
    ):
        result = _adapt(earn, every, start, sigma, _share(shared_until, parts), seed)
        found.append(result.mean)
        iterations += result.iterations
    best = every.into(_best(earn, every, found))
    own, own_iterations = _search_own(earn, best, _OWN_SIGMA, own_until, seed)
    return Searched(
        best,
        own,
        iterations,
        own_iterations,
        earn.seconds,
        earn.compile_seconds,
        lambda *arguments: _search_own(earn, *arguments)[0],
    )


def _search_own(
    earn: Earn, params: Params, sigma: float, until: float, seed: int
) -> tuple[Params, int]:
    """Searches around a policy for all weights but the net's, or the shared ones of too many."""
    weights = weights_of(params, ["shared", "own"])
    if weights.start.size > _MOST_OWN_WEIGHTS:
        weights = weights_of(params, ["shared"])
    result = _adapt(earn, weights, weights.start, sigma, until, seed, separable=True)
    return weights.into(result.mean), result.iterations


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
    feedback = planner.plan.feedback
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
