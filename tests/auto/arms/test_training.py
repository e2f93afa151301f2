"""The arms that compile programs of their own: policies of JaxPlan's classes, trained in slices."""

import math
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.lakes import preset, write_lake
from helpers.learners import taken
from helpers.problems import assert_same_bits
from jax.flatten_util import ravel_pytree

from mdpo_rddl.auto import RaceOptions
from mdpo_rddl.auto.arena import plain
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.arena.plain import PlainPlanners
from mdpo_rddl.auto.arms import training
from mdpo_rddl.auto.arms.parameter_exploration import ParameterExplorationArm
from mdpo_rddl.auto.arms.training import TrainingArm
from mdpo_rddl.auto.common.state import State
from mdpo_rddl.auto.race import race
from mdpo_rddl.auto.search.pgpe import Exploring, ParameterExploration
from mdpo_rddl.auto.search.steps import step_factor
from mdpo_rddl.errors import Cancelled, InputError
from mdpo_rddl.planner.config.presets.by_domain import config_for_domain

FOREVER = 300.0
ITERATIONS = 400


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    lake = write_lake(tmp_path_factory.mktemp("lake"))
    options = RaceOptions(most_iterations=ITERATIONS)
    return race._arena(lake, preset(FOREVER), 0, time.monotonic(), options)


@pytest.fixture
def arena(compiled):
    """One whose judge knows the no-op only."""
    judge = Judge(128, 0, time.monotonic, compiled.began)
    judge._players = compiled.judge._players
    arena = replace(compiled, judge=judge)
    arena.__dict__["plain"] = compiled.plain
    judge.record(arena.candidate("", "no-op", arena.noop))
    return arena


@pytest.mark.long
def test_a_straight_line_plan_is_trained_in_slices(arena):
    told = []
    arm = TrainingArm(replace_told(arena, told), "slp")
    arm.begin(time.monotonic() + FOREVER)
    assert not arm.is_pending
    assert arm.reached is None
    arm.work(time.monotonic())
    done, first = arm.log.iterations, arm.reached
    assert 0 < done < ITERATIONS
    assert first > -math.inf
    while not arm.is_exhausted:
        arm.work(time.monotonic())
    assert arm.log.iterations == ITERATIONS
    *_, best = taken(arm, arena.judge)
    assert best.planner is arena.plain.built("slp").planner
    assert set(best.params) == {"pump"}
    assert arm.reached == arm.log.best_return > arena.judge.latest("no-op").mean
    assert 0.0 < arm.log.compile_seconds <= arm.log.seconds
    # as part of the race, and with the best return of all
    assert 0.0 < told[0].fraction < 1.0
    assert told[0].best_return >= arena.judge.latest("no-op").mean
    # an arm of a race that goes on begins with it
    later = TrainingArm(arena, "slp")
    later.begin(time.monotonic() + FOREVER)
    assert_same_bits(later._training._built.arguments["guess"], best.params)


@pytest.mark.long
def test_where_nothing_more_is_gained_the_steps_change(arena, monkeypatch):
    monkeypatch.setattr(training, "has_stalled", lambda iterations, best: True)
    monkeypatch.setattr(training, "_LOOKING_SECONDS", 0.0)  # at each call
    planner, rates = arena.plain.built("slp").planner, []
    first = planner.optimizer_kwargs["learning_rate"]
    vary = planner.vary_restarts
    monkeypatch.setattr(
        planner, "vary_restarts", lambda **given: (rates.append(given), vary(**given))
    )
    arm, found = TrainingArm(replace_told(arena, []), "slp"), []
    arm.begin(time.monotonic() + FOREVER)
    while not arm.is_exhausted:
        arm.work(time.monotonic() + FOREVER)
        found += taken(arm, arena.judge)
    assert rates
    expected = [first * step_factor(phase) for phase in range(1, len(rates) + 1)]
    assert [given["learning_rate"] for given in rates] == [[rate] for rate in expected]
    # the phases follow each other, and the best of all is what is offered
    assert arm.log.iterations == ITERATIONS
    iterations = [record.iteration for record in arm.log.records]
    assert iterations == sorted(set(iterations))
    best = max(arm.log.records, key=lambda record: record.test_return)
    assert arm.log.details["estimate"] >= best.test_return
    assert found[-1].label == f"slp, iteration {arm._best_iteration:,}"
    vary()


def test_without_chance_one_rollout_is_enough(arena):
    for single, size in ((["slp"], 1), (["drp"], 32), ([], 32)):
        config = PlainPlanners(arena.problem, single).config("slp")
        assert config.section("Planner")["batch_size_train"] == size


def test_a_straight_line_plan_has_momentum_unless_its_configuration_says_more(arena, monkeypatch):
    jaxplans = config_for_domain("", arena.problem.domain_name, "slp").section("Planner")
    ours = PlainPlanners(arena.problem).config("slp").section("Planner")
    assert (jaxplans["optimizer"], ours["optimizer"]) == ("rmsprop", "adam")
    rate = jaxplans["optimizer_kwargs"]["learning_rate"]
    assert ours["optimizer_kwargs"] == {"learning_rate": 2.0 * rate, "b2": 0.95}
    drp = config_for_domain("", arena.problem.domain_name, "drp").section("Planner")
    assert PlainPlanners(arena.problem).config("drp").section("Planner") == {**drp, "pgpe": None}
    for other in ({"optimizer": "sgd"}, {"optimizer_kwargs": {"learning_rate": 0.1, "decay": 0.5}}):
        told = config_for_domain("", "none", "slp").with_values("Planner", **other)
        monkeypatch.setattr(plain, "config_for_domain", lambda *_, told=told: told)
        planner = PlainPlanners(arena.problem).config("slp").section("Planner")
        assert planner == {**told.section("Planner"), "pgpe": None}


def replace_told(arena, told: list):
    listening = replace(arena, on_progress=told.append)
    listening.__dict__["plain"] = arena.plain
    return listening


def test_parameters_of_a_net_are_explored(arena):
    arm = ParameterExplorationArm(arena)
    arm.begin(time.monotonic() + FOREVER)
    arm.work(time.monotonic() + 1.0)
    # the judge's program may be compiled yet
    arm.await_program(time.monotonic() + FOREVER)
    arm.work(time.monotonic())
    candidates = taken(arm, arena.judge)
    assert candidates[0].label == "pgpe, mean"
    assert {candidate.label for candidate in candidates[1:]} <= {"pgpe, best"}
    assert arm.log.best_return > arena.judge.latest("no-op").mean
    assert arm.log.iterations > 1
    # an arm of a race that goes on begins with the best of them
    later = ParameterExplorationArm(arena)
    later.begin(time.monotonic() + FOREVER)
    start, _ = ravel_pytree(arena.judge.best_of_arm("pgpe").params)
    np.testing.assert_array_equal(later._exploration.mean, start)
    # far behind the incumbent, nothing more is handed in
    leader = replace(candidates[0], label="leader", planner=None, mean=1e9, error=0.0)
    arena.judge.record(leader)
    arm = ParameterExplorationArm(arena)
    arm.begin(time.monotonic() + FOREVER)
    arm.work(time.monotonic())
    assert arm.take_candidates() == []
    assert arm.log.best_return is None
    assert arm.reached == arm.log.details["estimate"] < 0.0


def test_a_lucky_sample_is_no_estimate(arena, monkeypatch):
    # whatever the parameters, returns are of a normal law around 0
    def by_chance(iteration, vectors):
        return np.random.default_rng(iteration).normal(size=len(vectors))

    arm = ParameterExplorationArm(arena)
    monkeypatch.setattr(arm, "_evaluate", by_chance)
    stochastic = replace(arena.probe, deterministic=False)
    monkeypatch.setattr(arm, "_arena", replace(arena, probe=stochastic))
    arm._exploration = ParameterExploration(np.zeros(3), Exploring(), Ticking())
    estimates, lucky = [], []
    for number in range(1, 11):
        arm._exploration.run(by_chance, until=300.0 * number)
        lucky.append(arm._exploration.best_return)
        estimates.append(arm._recorded(iterations=300))
    assert min(lucky) > 2.5
    # the best of three means of two or three samples in 8 batches, not of all ten slices
    assert abs(np.mean(estimates)) < 0.6


def test_nobody_waits_for_a_compilation_longer_than_asked(arena, monkeypatch):
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


def test_others_work_while_what_plays_its_policies_is_compiled(arena, monkeypatch):
    released, judge = threading.Event(), arena.judge
    monkeypatch.setattr(judge, "prepare", lambda planner, params: released.wait(60.0))
    arm = TrainingArm(arena, "slp")
    arm.begin(time.monotonic() + FOREVER)
    arm.work(time.monotonic() + 0.1)
    assert arm.is_pending
    assert arm.awaits_judge
    assert arm.take_candidates() == []
    released.set()
    arm.await_program(time.monotonic() + 60.0)
    arm.work(time.monotonic())
    assert taken(arm, judge)
    assert not arm.awaits_judge


def test_a_program_is_worth_waiting_for_twice_what_it_should_take(arena, monkeypatch):
    released = threading.Event()
    arm = TrainingArm(arena, "slp", usual_seconds=0.2)
    assert not arm.is_worth_waiting(60.0)  # nothing is compiled
    monkeypatch.setattr(arm, "_compile", lambda seconds: released.wait(60.0))
    arm.begin(time.monotonic())
    assert arm.is_worth_waiting(60.0)
    assert not arm.is_worth_waiting(0.1)  # it would not be ready
    arm.await_program(time.monotonic() + 0.5)
    assert not arm.is_worth_waiting(60.0)
    released.set()


def test_what_would_be_compiled_too_late_ends_the_arm(arena):
    arm = TrainingArm(arena, "slp", usual_seconds=10 * FOREVER)
    arm.begin(time.monotonic() + 60.0)
    assert arm.is_exhausted
    assert not arm.is_pending
    assert "too little time" in arm.log.details["cause"]
    assert arm.log.compile_seconds == 0.0


def test_numbers_that_are_not_finite_are_counted_and_traced_once(arena):
    asked = []
    training = SimpleNamespace(diagnosis=lambda seconds: asked.append(seconds) or "the cause")
    arm = TrainingArm(arena, "slp")
    for returns, sensitivities in ((0, 0), (2, 0), (2, 3)):
        result = SimpleNamespace(not_finite=returns, lost_sensitivities=sensitivities, advice=None)
        arm._note_not_finite(training, result)
        if not returns:
            assert arm.log.details == {}
    assert arm.log.details == {"advice": "the cause", "not_finite": 5}
    assert len(asked) == 1


def test_what_cannot_be_compiled_ends_the_arm_alone(arena, monkeypatch):
    def refuse(seconds):
        raise InputError("no gradient")

    arm = TrainingArm(arena, "drp")
    monkeypatch.setattr(arm, "_compile", refuse)
    arm.begin(time.monotonic() + 60.0)
    arm.work(time.monotonic() + 60.0)
    assert arm.is_exhausted
    assert arm.log.details == {"cause": "no gradient"}


def test_a_phase_that_fails_leaves_what_an_earlier_one_has_found(arena, monkeypatch):
    arm = TrainingArm(arena, "slp")
    arm.begin(time.monotonic() + FOREVER)
    arm.work(time.monotonic())
    arm.await_program(time.monotonic() + FOREVER)
    arm.take_candidates()
    arm._offered = -1

    def diverged(training):
        raise InputError("training diverged")

    monkeypatch.setattr(arm, "_noted", diverged)
    arm.work(time.monotonic())
    assert [candidate.params is arm._best.params for candidate in arm.take_candidates()] == [True]
    assert arm.is_exhausted
    assert arm.log.details["cause"] == "training diverged"
    assert "estimate" in arm.log.details


def test_an_interrupted_training_ends_the_race(arena, monkeypatch):
    def cancelled(progress):
        raise Cancelled

    arm = TrainingArm(arena, "slp")
    arm.begin(time.monotonic() + FOREVER)
    monkeypatch.setattr(arm._training, "_on_progress", cancelled)
    with pytest.raises(Cancelled):
        arm.work(time.monotonic() + 60.0)
    # another process may go on with it
    assert not arm.is_exhausted
    assert arm.state() is not None


@pytest.fixture
def varied(arena, monkeypatch):
    """What the restarts of the plans' planner were given, one after the other."""
    given = []
    planner = arena.plain.built("slp").planner
    monkeypatch.setattr(planner, "vary_restarts", lambda **values: given.append(values))
    return given


def test_a_phase_that_is_refused_leaves_no_step_size(arena, monkeypatch, varied):
    best = SimpleNamespace(params={"pump": np.zeros(8)}, mean_return=-1.0)
    monkeypatch.setattr(training, "BestIterate", SimpleNamespace(of=lambda *given: best))
    arm, begun = TrainingArm(arena, "slp"), []

    def refuse(built, seconds, state=None):
        if state is not None:
            raise ValueError("other shapes")
        begun.append(arm._phase)

    monkeypatch.setattr(arm, "_compiled_training", refuse)
    values = {"phase": 2, "iterations": 7, "best_iteration": 3, "best": {}, "training": {}}
    arm._resumed = State({}, values)
    arm._compile(1.0)
    assert [bool(each) for each in varied] == [True, False]
    assert begun == [0]
    assert arm._iterations == 0


def test_a_training_that_is_begun_anew_ends_the_old_one(arena, monkeypatch, varied):
    arm, done = TrainingArm(arena, "slp"), []
    arm._training = SimpleNamespace(close=lambda: done.append("closed"))
    monkeypatch.setattr(arm, "_begin", lambda: done.append("begun"))
    arm._begin_anew(InputError("other shapes"))
    assert done == ["closed", "begun"]
    assert varied == [{}]
    assert arm._training is None
