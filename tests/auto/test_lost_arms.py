"""Races that are interrupted, or whose arms are lost, keep the best so far."""

import jax
import numpy as np
import pytest
from helpers.races import CLOCK, means, raced

from mdpo_rddl.auto import RaceOptions, race, schedule
from mdpo_rddl.auto.search.population import PopulationReturns
from mdpo_rddl.errors import Cancelled, InputError

pytestmark = pytest.mark.usefixtures("one_core")
NOOP, CONSTANT = "no-op", "constant"


def test_an_interrupt_keeps_the_best_policy_so_far(lake, in_one_arena, monkeypatch):
    def interrupted(*arguments, **keywords):
        raise KeyboardInterrupt

    monkeypatch.setattr(schedule.SharedWeightsArm, "_work", interrupted)
    outcome = raced(lake, 300.0)
    assert outcome.interrupted
    assert outcome.chosen.arm == "constants and rules"
    monkeypatch.setattr(schedule.Schedule, "run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        raced(lake, 300.0)


def test_an_interrupted_phase_is_judged(lake, in_one_arena):
    def cancelled(progress):
        raise Cancelled

    options = RaceOptions(clock=CLOCK, most_iterations=60, on_progress=cancelled)
    outcome = raced(lake, 2500.0, options)
    assert outcome.interrupted
    assert outcome.judged[-1].candidate.label == "phase 1, last iterate"


def test_what_jaxplan_cannot_compile_is_one_line(lake, monkeypatch):
    def broken(*arguments, **keywords):
        raise AttributeError("module has no attribute\n'distributions'")

    monkeypatch.setattr(race, "probe", broken)
    with pytest.raises(InputError, match=r"i\.rddl: cannot be planned: .*no attribute 'dist"):
        raced(lake, 300.0)


def test_where_every_arm_is_lost_the_best_so_far_is_kept(
    lake, in_one_arena, no_gradient, monkeypatch, caplog
):
    def lost(arm, until):
        raise FloatingPointError("nothing is finite")

    names = ("SharedWeightsArm", "PlanArm", "OwnWeightsArm")
    for name in names:
        monkeypatch.setattr(getattr(schedule, name), "_work", lost)
    outcome = raced(lake, 300.0)
    for name in ("shared weights", "plan", "own weights", "polishing the weights"):
        assert f"{name} is given up: nothing is finite" in caplog.text
    assert outcome.chosen.arm == "constants and rules"
    assert not outcome.interrupted
    assert outcome.chosen.mean >= means(outcome)[CONSTANT] > means(outcome)[NOOP]


def test_where_no_return_of_a_search_is_finite_the_best_so_far_is_kept(
    lake, in_one_arena, no_gradient, monkeypatch
):
    monkeypatch.setattr(
        PopulationReturns, "__call__", lambda self, weights, number, vectors: vectors[:, 0] * np.nan
    )
    outcome = raced(lake, 300.0)
    assert np.isfinite(outcome.chosen.mean)
    assert outcome.chosen.mean >= means(outcome)[CONSTANT]
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(outcome.policy.params))
