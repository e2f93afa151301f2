"""Races that are interrupted, or whose arms are lost, keep the best so far."""

from types import SimpleNamespace

import jax
import numpy as np
import pytest
from helpers import toy_mdps as toys
from helpers.clocks import Stopped
from helpers.lakes import preset
from helpers.races import CLOCK, means, raced

from mdpo_rddl.auto import RaceOptions
from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.arms import dynamic_programming
from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.race import race, schedule
from mdpo_rddl.auto.race.slices import Slices
from mdpo_rddl.auto.search.population import PopulationReturns
from mdpo_rddl.errors import Cancelled, InputError
from mdpo_rddl.planner.config.search_section import OPTIONAL_ARMS

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


@pytest.mark.usefixtures("failing_race")
def test_a_failure_of_the_race_itself_keeps_the_best_so_far(
    lake, in_one_arena, monkeypatch, caplog
):
    def broken(anything):
        raise MemoryError("out of memory")

    monkeypatch.setattr(Arena, "random_return", broken)
    outcome = raced(lake, 300.0)
    assert "the best policy so far is kept: out of memory" in caplog.text
    assert outcome.chosen.mean == max(means(outcome).values())
    assert not outcome.interrupted
    monkeypatch.setattr(schedule.Schedule, "run", broken)
    with pytest.raises(InputError, match="out of memory"):
        raced(lake, 300.0)


@pytest.mark.usefixtures("failing_race")
def test_what_cannot_be_judged_costs_nobody_else_a_slice(monkeypatch, caplog):
    clock = Stopped()
    judge = Judge(1, 0, clock, 0.0)
    arena = SimpleNamespace(judge=judge, clock=clock, deadline=10.0)
    first, broken, better = (
        Candidate("arm", label, preset(1.0), None, None, mean=mean)
        for label, mean in (("first", 0.0), ("broken", None), ("better", 1.0))
    )
    slices = Slices(arena, lambda name: None)
    with pytest.raises(ValueError, match="no planner"):
        slices.give(Offering("early", clock, [broken]), 1.0)
    assert slices.give(Offering("arm", clock, [first, broken, better]), 1.0)
    assert judge.incumbent.label == "better"
    assert "broken: there is no planner" in caplog.text


@pytest.mark.parametrize("stop", [KeyboardInterrupt(), Cancelled()])
def test_a_stop_while_candidates_are_judged_loses_none_that_are_known(monkeypatch, stop):
    clock = Stopped()
    judge = Judge(1, 0, clock, 0.0)
    arena = SimpleNamespace(judge=judge, clock=clock, deadline=10.0)
    found = [
        Candidate("arm", label, preset(1.0), None, None, mean=mean)
        for label, mean in (("first", 0.0), ("stopped", 1.0), ("compiled", None), ("better", 2.0))
    ]
    record = judge.record

    def stopped(candidate):
        assert candidate.label != "compiled"
        if candidate.label == "stopped":
            raise stop
        return record(candidate)

    monkeypatch.setattr(judge, "record", stopped)
    with pytest.raises(type(stop)):
        Slices(arena, lambda name: None).give(Offering("arm", clock, found), 1.0)
    assert judge.incumbent.label == "better"


class Offering(Arm):
    """Offers what it is given."""

    def __init__(self, name, clock, candidates):
        super().__init__(name, clock)
        self._candidates = candidates

    def _work(self, until):
        for candidate in self._candidates:
            self._offer(candidate)


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


@pytest.mark.parametrize("problem", ["lake", "corridor"])
def test_arms_that_are_left_out_get_no_slice(problem, request, monkeypatch):
    toy, in_use = request.getfixturevalue(problem), []
    work = Arm.work

    def noted(arm, until):
        in_use.append(arm.name)
        work(arm, until)

    monkeypatch.setattr(Arm, "work", noted)
    outcome = raced(toy, 300.0, without=list(OPTIONAL_ARMS))
    assert set(in_use) == {"constants and rules"}
    assert [log.name for log in outcome.arms] == ["constants and rules"]
    assert outcome.chosen.arm == "constants and rules"


@pytest.mark.long
def test_without_the_optimum_its_model_is_there_for_the_trials(tmp_path, monkeypatch):
    def refuse(*arguments):
        raise AssertionError("asked for")

    monkeypatch.setattr(dynamic_programming, "find_optimum", refuse)
    outcome = raced(toys.walk(tmp_path, 6), 300.0, without=list(OPTIONAL_ARMS[:1]))
    assert "trials" in [log.name for log in outcome.arms]
    assert outcome.optimum is None
