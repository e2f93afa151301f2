"""The arms that compile programs of their own: policies of JaxPlan's classes, trained in slices."""

import threading
import time

import pytest
from helpers.lakes import preset, write_lake

from mdpo_rddl.auto import RaceOptions, race
from mdpo_rddl.auto.arms.parameter_exploration import ParameterExplorationArm
from mdpo_rddl.auto.arms.training import TrainingArm
from mdpo_rddl.auto.judge import Judge
from mdpo_rddl.errors import Cancelled, InputError

FOREVER = 300.0


@pytest.fixture(scope="module")
def arena(tmp_path_factory):
    lake = write_lake(tmp_path_factory.mktemp("lake"))
    told = []
    options = RaceOptions(most_iterations=400, on_progress=told.append)
    arena = race._arena(lake, preset(FOREVER), 0, time.monotonic(), options)
    arena.judge.record(arena.candidate("", "no-op", arena.noop))
    return arena, told


def judged(arm, judge: Judge) -> list:
    candidates = arm.take_candidates()
    for candidate in candidates:
        judge.record(candidate)
        arm.judged(judge.judged[-1].candidate)
    return candidates


def test_a_straight_line_plan_is_trained_in_slices(arena):
    arena, told = arena
    arm = TrainingArm(arena, "slp")
    arm.begin(time.monotonic() + FOREVER)
    assert not arm.is_pending
    arm.work(time.monotonic())
    (first,) = judged(arm, arena.judge)
    done = arm.log.iterations
    assert 0 < done < 400
    assert first.mean is None
    assert first.planner is arena.plain.built("slp").planner
    assert set(first.params) == {"pump"}
    while not arm.is_exhausted:
        arm.work(time.monotonic())
    judged(arm, arena.judge)
    assert arm.log.iterations == 400 > done
    assert arm.log.best_return > arena.judge.latest("no-op").mean
    assert 0.0 < arm.log.compile_seconds <= arm.log.seconds
    # as part of the race, and with the best return of all
    assert 0.0 < told[0].fraction < 1.0
    assert told[-1].best_return >= arena.judge.best_mean


def test_parameters_of_a_net_are_explored(arena):
    arena, _ = arena
    arm = ParameterExplorationArm(arena)
    arm.begin(time.monotonic() + FOREVER)
    for _ in range(3):
        arm.work(time.monotonic() + 0.5)
        labels = [candidate.label for candidate in judged(arm, arena.judge)]
        assert labels == ["pgpe, mean", "pgpe, sample"]
    assert arm.log.slices == 3
    assert arm.log.best_return > arena.judge.latest("no-op").mean
    assert arm.log.iterations > 3


def test_nobody_waits_for_a_compilation_longer_than_asked(arena, monkeypatch):
    arena, _ = arena
    released = threading.Event()
    arm = TrainingArm(arena, "slp")
    monkeypatch.setattr(arm, "_compile", lambda seconds: released.wait(60.0))
    arm.begin(time.monotonic())
    assert arm.is_pending
    arm.work(time.monotonic())
    assert arm.take_candidates() == []
    released.set()
    assert arm._is_compiled(time.monotonic() + 60.0)
    assert not arm.is_pending


def test_what_cannot_be_compiled_ends_the_arm_alone(arena, monkeypatch):
    arena, _ = arena

    def refuse(seconds):
        raise InputError("no gradient")

    arm = TrainingArm(arena, "drp")
    monkeypatch.setattr(arm, "_compile", refuse)
    arm.begin(time.monotonic() + 60.0)
    arm.work(time.monotonic() + 60.0)
    assert arm.is_exhausted
    assert arm.log.details == {"cause": "no gradient"}


def test_an_interrupted_training_offers_what_it_has(arena, monkeypatch):
    arena, _ = arena

    def cancelled(progress):
        raise Cancelled

    arm = TrainingArm(arena, "slp")
    arm.begin(time.monotonic() + FOREVER)
    monkeypatch.setattr(arm._training, "_on_progress", cancelled)
    with pytest.raises(Cancelled):
        arm.work(time.monotonic() + 60.0)
    assert [candidate.arm for candidate in arm.take_candidates()] == ["slp"]
