"""What is better than the no-op, by the judge's rollouts."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.clocks import Stopped
from helpers.lakes import preset

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.common.candidate import NOOP, Candidate
from mdpo_rddl.auto.common.gains import (
    NoopReturn,
    finite_gain,
    return_to_beat,
    return_to_beat_by_luck,
)

# a random return of the no-op, -100 +- 20
RETURNS = np.random.default_rng(0).normal(-100.0, 20.0, 128)


def arena_of(noop: np.ndarray, probed: float) -> Arena:
    """One whose planner's parameters are the returns of the rollouts."""
    planner, judge = object(), Judge(128, 0, Stopped(), 0.0)
    judge._players.append((planner, lambda params: params))
    arena = Arena(
        problem=None,
        config=preset(1.0),
        planner=planner,
        probe=SimpleNamespace(noop_return=probed),
        judge=judge,
        seed=0,
        deadline=1.0,
    )
    judge.record(arena.candidate("", NOOP, noop))
    return arena


def judged(arena: Arena, returns: np.ndarray) -> Candidate:
    arena.judge.record(arena.candidate("", "other", returns))
    return arena.judge.latest("other")


@pytest.mark.parametrize("probed", [-150.0, -60.0])
def test_what_probing_saw_of_a_random_no_op_decides_nothing(probed):
    arena = arena_of(RETURNS, probed)
    assert not arena.beats_noop(judged(arena, RETURNS))
    assert not arena.beats_noop(judged(arena, RETURNS + 0.4))
    # 5 in 100, in each rollout
    assert arena.beats_noop(judged(arena, RETURNS + 5.0))


def test_what_chance_alone_explains_is_no_gain():
    arena = arena_of(RETURNS, -100.0)
    others = np.random.default_rng(1).normal(size=128)
    others = (others - others.mean()) * 20.0 + RETURNS.mean()
    error = np.std(others - RETURNS, ddof=1) / math.sqrt(128)
    assert not arena.beats_noop(judged(arena, others + 0.8 * error))
    assert arena.beats_noop(judged(arena, others + error))


def test_one_success_counts_where_the_no_op_has_none():
    arena = arena_of(np.full(128, -40.0), -40.0)
    returns = np.full(128, -40.0)
    returns[7] = -10.0
    assert arena.beats_noop(judged(arena, returns))


def test_anything_finite_is_more_than_what_is_not():
    arena = arena_of(np.full(128, np.nan), -np.inf)
    assert arena.noop_return.mean == -np.inf
    assert arena.beats_noop(judged(arena, RETURNS))
    assert not arena.beats_noop(judged(arena, np.full(128, np.nan)))
    assert return_to_beat_by_luck(arena.noop_return, 4) == -np.inf
    assert finite_gain(-3.0, -np.inf) == 0.0
    assert finite_gain(-3.0, -5.0) == 2.0


def test_without_a_judged_no_op_probing_says_what_it_returns():
    arena = arena_of(RETURNS, -7.0)
    arena.judge.judged.clear()
    assert arena.noop_return == (-7.0, 0.0)


def test_the_best_of_many_plans_must_be_beyond_luck():
    arena = arena_of(RETURNS, -100.0)
    assert arena.noop_return.deviation == pytest.approx(np.std(RETURNS, ddof=1))
    # four standard errors of a mean of four rollouts
    assert return_to_beat_by_luck(NoopReturn(-100.0, 20.0), 4) == -60.0
    # without chance half a percent is enough
    assert (
        return_to_beat_by_luck(NoopReturn(-100.0, 0.0), 1) == return_to_beat(-100.0, 0.0) == -99.5
    )
