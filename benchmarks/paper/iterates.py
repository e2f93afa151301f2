"""Which iterates of a training are looked at, and what is kept of them."""

import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

LAST = 5
"""The paper's figure is the mean over so many last iterates."""

# much happens at the beginning
_EARLY = (2, 5, 10, 20)


class Iterate(NamedTuple):
    """What all seeds have reached after some iterations.

    Attributes:
      iteration: number of iterations done.
      seconds: training time till then, compilation not counted.
      params: the policies' parameters [S, ...].
      sigma: the noise's scale per step, mean over the seeds [H]; None where there is none.
    """

    iteration: int
    seconds: float
    params: Any
    sigma: np.ndarray | None = None


def kept_iterations(iterations: int, points: int = 60) -> list[int]:
    """Some of the first iterates, about `points` more evenly spaced, and the last `LAST`."""
    every = max(1, iterations // points)
    last = range(max(1, iterations - LAST + 1), iterations + 1)
    early = (1, *(i for i in _EARLY if i < every))
    return sorted({*early, *range(every, iterations + 1, every), *last})


def timed(
    advance: Callable[[int], tuple[Any, Any]], iterations: Sequence[int]
) -> Iterator[Iterate]:
    """Times a training that stops at some iterations.

    Args:
      advance: trains until so many iterations are done; gives parameters and sigma [S, H] or
        None, ready or not.
      iterations: where to stop, in order.
    """
    seconds = 0.0
    for iteration in iterations:
        started = time.perf_counter()
        params, sigma = advance(iteration)
        params = jax.tree.map(np.asarray, params)
        seconds += time.perf_counter() - started
        mean_sigma = None if sigma is None else np.asarray(sigma).mean(axis=0)
        yield Iterate(iteration, seconds, params, mean_sigma)
