"""The part of the recipe that needs no gradient: shared weights first, then each object's own."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import jax
import numpy as np

from mdpo_rddl.auto.search import SearchResult, search
from mdpo_rddl.auto.weights import Weights, weights_of
from mdpo_rddl.feedback import Params
from mdpo_rddl.jaxplan.exact import compile_returns, state_bytes
from mdpo_rddl.jaxplan.planner import MDPOPlanner

logger = logging.getLogger(__name__)

_POPULATION = 32
# rollouts of a candidate, the first that fits: they are all computed side by side
_ROLLOUTS = (4, 2, 1)
_MOST_BYTES = 2 * 10**7
# a search of fewer iterations than that finds nothing: then one rollout has to do
_FEWEST_ITERATIONS = 100
_WIDE_BATCHES = 16
_SHARED_SIGMA, _REFINING_SIGMA, _OWN_SIGMA = 0.5, 0.1, 0.03
_MOST_OWN_WEIGHTS = 5000
_FINAL_BATCHES = 8


Earn = Callable[[Weights, int, np.ndarray], np.ndarray]
"""(which weights, iteration, vectors [P, D]) -> mean returns [P]."""


@dataclass(frozen=True)
class Searched:
    """What the search found.

    Attributes:
      shared: parameters after the search for the shared weights.
      params: after the search for each object's own, which starts there.
      shared_iterations, own_iterations: done.
      polish: (policy, sigma, until, seed) -> a policy searched for around it, and iterations.
    """

    shared: Params
    params: Params
    shared_iterations: int
    own_iterations: int
    polish: Callable[[Params, float, float, int], tuple[Params, int]]


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
    random = np.random.default_rng(seed)
    size = (_POPULATION * _WIDE_BATCHES, simple.start.size)
    # most of the weights of a simple rule are zero
    scales = random.choice([0.0, 1.0, 3.0], size=size, p=[0.5, 0.3, 0.2])
    wide = random.normal(size=size) * scales * _SHARED_SIGMA
    earned = np.concatenate([earn(simple, 0, batch) for batch in np.split(wide, _WIDE_BATCHES)])
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
    return Searched(best, own, iterations, own_iterations, partial(_search_own, earn))


def _search_own(
    earn: Earn, params: Params, sigma: float, until: float, seed: int
) -> tuple[Params, int]:
    """Searches around a policy for all weights but the net's."""
    own = weights_of(params, ["shared", "own"])
    if own.start.size > _MOST_OWN_WEIGHTS:
        return params, 0
    result = _adapt(earn, own, own.start, sigma, until, seed, separable=True)
    return own.into(result.mean), result.iterations


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
        population=_POPULATION,
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


def _compile(planner: MDPOPlanner, params: Params, seed: int, until: float) -> Earn:
    """Exact returns of a population, with as many rollouts as memory and time allow."""
    size = state_bytes(planner) * _POPULATION
    fitting = [count for count in _ROLLOUTS if count * size <= _MOST_BYTES] or [1]
    key = jax.random.PRNGKey(seed)
    shared = weights_of(params, ["shared"])
    zeros = np.zeros((_POPULATION, shared.start.size))
    for count in dict.fromkeys([fitting[0], 1]):
        returns = compile_returns(planner, count)

        def earn(weights: Weights, iteration: int, vectors: np.ndarray, returns=returns):
            now = jax.random.fold_in(key, iteration)
            return np.mean(np.asarray(returns(now, weights.batch(vectors)), float), axis=1)

        earn(shared, 0, zeros)
        started = time.monotonic()
        earn(shared, 0, zeros)
        seconds = time.monotonic() - started
        logger.info("%d rollouts of %d candidates take %.3g s", count, _POPULATION, seconds)
        if seconds * _FEWEST_ITERATIONS < until - started:
            break
    return earn


def _best(earn: Earn, weights: Weights, found: list[np.ndarray]) -> np.ndarray:
    """The vector that earns most in fresh rollouts."""
    batch = np.stack([found[number % len(found)] for number in range(_POPULATION)])
    fresh = [earn(weights, 10**6 + number, batch) for number in range(_FINAL_BATCHES)]
    means = np.mean(fresh, axis=0)[: len(found)]
    return found[int(np.argmax(np.where(np.isfinite(means), means, -np.inf)))]
