"""A race that was stopped goes on with its candidates and its seconds, by a clock of its own."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.lakes import preset, write_lake

from mdpo_rddl.auto import RaceOptions, plan_automatically
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.arms.gradient import Training
from mdpo_rddl.auto.race import affording, race
from mdpo_rddl.auto.resuming.earlier import EarlierPolicy, EarlierRace
from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.config.jaxplan_configs import jaxplan_config
from mdpo_rddl.session.race_checkpoints import RaceCheckpoints

CLOCK = Ticking()
TICKS = 600.0


@pytest.fixture(scope="module")
def lake(tmp_path_factory):
    return write_lake(tmp_path_factory.mktemp("lake"))


@pytest.fixture(scope="module")
def compiled(lake):
    return race._arena(lake, preset(1000.0), 0, CLOCK(), RaceOptions(clock=CLOCK))


@pytest.fixture(autouse=True)
def _in_one_arena(compiled, monkeypatch):
    """Programs are compiled once, and compilations are waited for."""

    def refuse(training):
        raise InputError("this model has no gradient")

    def as_new(problem, config, seed, began, options):
        judge = Judge(128, seed, CLOCK, began, options.on_judged)
        judge._players = compiled.judge._players
        deadline = began + config.section("Optimize")["train_seconds"]
        pulse = options.on_pulse
        arena = replace(compiled, judge=judge, deadline=deadline, began=began, pulse=pulse)
        arena.__dict__.update(population=compiled.population, plans=compiled.plans)
        compiled.plans.on_generation = pulse
        return arena

    monkeypatch.setattr(race, "_arena", as_new)
    monkeypatch.setattr(Training, "compile", refuse)
    monkeypatch.setattr(affording, "usable_cores", lambda: 1)


def stopped(lake, folder, stage: str) -> EarlierRace:
    """What a race leaves that goes on with what is in a folder, and is interrupted in a stage."""
    terms = SimpleNamespace(problem=lake, seed=0, config=preset(TICKS))
    checkpoints = RaceCheckpoints(folder, terms, 1e9)
    stages, left = [], iter(range(9))

    def pulse() -> None:
        checkpoints.pulse()
        if stages[-1] == stage and next(left, None) is None:
            raise KeyboardInterrupt

    options = RaceOptions(
        clock=CLOCK,
        earlier=checkpoints.start,
        on_stage=stages.append,
        on_judged=checkpoints.judged,
        on_begun=checkpoints.begun,
        on_pulse=pulse,
    )
    outcome = plan_automatically(lake, terms.config, 0, options)
    assert outcome.interrupted
    checkpoints.stopped(outcome.seconds)
    start = RaceCheckpoints(folder, terms, 1e9).start
    assert start.seconds == outcome.seconds
    return start


def resumed(lake, earlier: EarlierRace):
    outcome = plan_automatically(lake, preset(TICKS), 0, RaceOptions(clock=CLOCK, earlier=earlier))
    assert outcome.chosen.mean >= earlier.incumbent.mean
    assert earlier.seconds < outcome.seconds < 1.2 * TICKS
    figures = outcome.diagnostics()
    before, after = np.split(np.array(figures["candidates"]), [len(earlier.curve)])
    # the curve goes on where it was
    assert before.tolist() == list(earlier.curve)
    seconds = [point["seconds"] for point in (*before, *after)]
    assert seconds == sorted(seconds)
    assert after[0]["seconds"] > earlier.seconds
    assert list(outcome.policy.candidates) == figures["candidates"]
    return outcome


def test_a_policy_of_a_race_with_another_time_is_of_the_planner(compiled):
    for kept, fits in (({}, True), ({"cosines": 3}, False)):
        config = compiled.config.with_values("Optimize", train_seconds=7.0)
        config = config.with_policy_arguments(**kept)
        earlier = EarlierPolicy(config, compiled.noop, {}, "a", "b", (), False, 1.0, 0.0)
        assert (earlier.candidate(compiled).planner is compiled.planner) is fits


@pytest.mark.parametrize("stage", ["searching", "racing"])
def test_a_race_goes_on_with_its_candidates_and_its_seconds(lake, tmp_path, stage):
    earlier = stopped(lake, tmp_path, stage)
    known = [earlier.incumbent, *earlier.others]
    assert len(known) > 1
    outcome = resumed(lake, earlier)
    # they are judged again before any other
    judged = [each.candidate for each in outcome.judged[: len(known)]]
    assert [(each.arm, each.label) for each in judged] == [(each.arm, each.label) for each in known]
    assert [each.known_mean for each in judged] == pytest.approx([each.mean for each in known])
    # the arms begin anew
    arms = outcome.diagnostics()["arms"]
    assert arms["constants and rules"]["iterations"] > 0
    assert arms["shared weights"]["slices"] > 0


def test_an_incumbent_of_another_planner_stays_unless_something_is_better(lake):
    config = jaxplan_config("default", "slp").with_section("Noise", {"method": "NoNoise"})
    params, mean = {"pump": np.full(8, 37.0)}, -2000.0
    # its time is over: it stays the result, whatever its error
    best = EarlierPolicy(config, params, {"pump": 1.0}, "slp", "slp", (), False, mean, 300.0)
    options = RaceOptions(clock=CLOCK, earlier=EarlierRace(TICKS, best))
    outcome = plan_automatically(lake, preset(TICKS), 0, options)
    assert outcome.chosen.arm == "slp"
    np.testing.assert_array_equal(outcome.policy.params["pump"], params["pump"])
    resumed(lake, EarlierRace(0.0, best))


def test_a_race_can_be_stopped_twice(lake, tmp_path):
    first = stopped(lake, tmp_path, "searching")
    second = stopped(lake, tmp_path, "racing")
    assert second.seconds > first.seconds
    assert second.incumbent.mean >= first.incumbent.mean
    assert first.curve
    assert second.curve[: len(first.curve)] == first.curve
    resumed(lake, second)
