"""Trains all seeds of a problem side by side, and keeps each one's best iterate."""

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import A_DAY, Budget
from mdpo_rddl.planner.planner import MDPOPlanner

# a step whose sensitivity is so much smaller than the largest has none
_FLAT = 1e-6
# iterations after the first, which compiles, from which the others are foreseen
_FORESEEN_FROM = 3


class TooLongError(Exception):
    """A training would take more time than it may."""


@dataclass(frozen=True)
class Trained:
    """What the seeds of one training found.

    Attributes:
      params: parameters of each seed's best iterate by JaxPlan's rolling test return [S, ...].
      best: that return [S].
      curves: the best one so far [S, I].
      last_improved: the share of the iterations after which it was found [S].
      flat_start: the share of the horizon at which the return does not answer to the action, at
        the first iteration [S].
      flat: the same, mean over the iterations [S].
      gap: how far the relaxed model's return is from the test return, as a share of the larger
        size of the two, mean over the iterations [S].
      first, seconds: the first test return [S]; wall-clock time of the iterations but the first.
    """

    params: Any
    best: np.ndarray
    curves: np.ndarray
    last_improved: np.ndarray
    flat_start: np.ndarray
    flat: np.ndarray
    gap: np.ndarray
    first: np.ndarray
    seconds: float


def train_lanes(
    built: Built[MDPOPlanner],
    key: Any,
    iterations: int,
    seeds: int,
    most_seconds: float = math.inf,
) -> Trained:
    """Trains every parallel update, and chooses among those of a seed as JaxPlan does.

    Args:
      built: with `seeds` times the parallel updates of the configuration.
      key: JAX random key.
      iterations: of the training.
      seeds: number of seeds S.
      most_seconds: CPU time that its iterations may take, as the first ones foresee it.

    Raises:
      TooLongError: if they would take longer.
    """
    lanes = built.planner.parallel_updates
    best, last, params = np.full(lanes, -np.inf), np.zeros(lanes, int), None
    returns, relaxed, flats = [], [], []
    started, spent = time.perf_counter(), time.process_time()
    for number, callback in enumerate(built.callbacks(key, Budget(iterations, A_DAY))):
        if not number:
            params, started = callback["params"], time.perf_counter()
            spent = time.process_time()
        elif number == _FORESEEN_FROM:
            _refuse_long(iterations * (time.process_time() - spent) / number, most_seconds)
        tested = np.asarray(callback["test_return"], float)
        tested = np.where(np.isfinite(tested), tested, -np.inf)
        ahead = tested > best
        best, last = np.where(ahead, tested, best), np.where(ahead, number, last)
        params = _chosen(ahead, callback["params"], params)
        returns.append(best)
        relaxed.append((tested, np.asarray(callback["train_return"], float)))
        flats.append(_flat_share(np.asarray(callback["sensitivity"])))
    seconds = time.perf_counter() - started
    winners = _winners(best, seeds)
    return Trained(
        params=jax.tree.map(lambda leaf: leaf[winners], params),
        best=best[winners],
        curves=np.stack(returns, axis=1)[winners],
        last_improved=last[winners] / max(1, iterations - 1),
        flat_start=flats[0][winners],
        flat=np.mean(flats, axis=0)[winners],
        gap=_gaps(relaxed)[winners],
        first=relaxed[0][0][winners],
        seconds=seconds,
    )


def _refuse_long(seconds: float, most_seconds: float) -> None:
    if seconds > most_seconds:
        raise TooLongError(f"a training would take {seconds:.0f} s of CPU time")


@jax.jit
def _chosen(ahead: Any, new: Any, old: Any) -> Any:
    def choose(one, other):
        return jnp.where(ahead.reshape(-1, *[1] * (one.ndim - 1)), one, other)

    return jax.tree.map(choose, new, old)


def _winners(best: np.ndarray, seeds: int) -> np.ndarray:
    """The best of each seed's parallel updates [S]."""
    count = len(best) // seeds
    return np.arange(seeds) * count + np.argmax(best.reshape(seeds, count), axis=1)


def _flat_share(sensitivity: np.ndarray) -> np.ndarray:
    largest = np.max(np.nan_to_num(sensitivity), axis=1, keepdims=True)
    return np.mean(~(sensitivity > _FLAT * largest), axis=1)


def _gaps(pairs: Iterable[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    gaps = []
    for tested, relaxed in pairs:
        size = np.maximum(np.maximum(np.abs(tested), np.abs(relaxed)), 1e-12)
        with np.errstate(invalid="ignore"):
            gaps.append(np.nan_to_num(np.abs(tested - relaxed) / size, nan=1.0, posinf=1.0))
    return np.minimum(1.0, np.mean(gaps, axis=0))


def best_of(trainings: list[Trained], values: list[np.ndarray]) -> np.ndarray:
    """Of each seed the value that belongs to the training with the best test return.

    Args:
      trainings: of the same seeds; of equal ones the first is taken.
      values: per training [S] or [S, ...].
    """
    chosen = np.argmax([trained.best for trained in trainings], axis=0)
    return np.stack([values[k][seed] for seed, k in enumerate(chosen)])


def best_curve(trainings: list[Trained]) -> np.ndarray:
    """The best test return so far of trainings side by side [S, I]."""
    return np.max([trained.curves for trained in trainings], axis=0)
