"""A race that was stopped goes on where it was, by a clock that does not wait."""

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.lakes import preset, write_lake

from mdpo_rddl.auto import RaceOptions, plan_automatically
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.arms.gradient import Training
from mdpo_rddl.auto.common.state import State
from mdpo_rddl.auto.race import affording, race
from mdpo_rddl.auto.resuming.earlier import EarlierPolicy, EarlierRace
from mdpo_rddl.auto.resuming.race_state import RaceState
from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.config.jaxplan_configs import jaxplan_config

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

    def as_new(problem, config, seed, began, options, resumption):
        judge = Judge(128, seed, CLOCK, began, options.on_judged)
        judge._players = compiled.judge._players
        deadline = began + config.section("Optimize")["train_seconds"]
        pulse = options.on_pulse
        arena = replace(compiled, judge=judge, deadline=deadline, began=began, pulse=pulse)
        arena.__dict__.update(population=compiled.population, plans=compiled.plans)
        compiled.plans.on_generation = pulse
        seen.append(resumption.probe)
        resumption.probe = compiled.probe
        return arena

    seen: list[object] = []
    monkeypatch.setattr(race, "_arena", as_new)
    monkeypatch.setattr(Training, "compile", refuse)
    monkeypatch.setattr(affording, "usable_cores", lambda: 1)


def stopped(lake, when: Callable[[RaceState], bool], earlier: EarlierRace | None = None):
    """What a race leaves that is interrupted in a slice, as it comes out of a file."""
    begun, kept = [], []

    def pulse() -> None:
        state = begun[0]()
        if when(state) and not kept:
            flat = state.flat()
            kept.append(State(dict(flat.tensors), json.loads(json.dumps(dict(flat.values)))))
            raise KeyboardInterrupt

    options = RaceOptions(clock=CLOCK, earlier=earlier, on_begun=begun.append, on_pulse=pulse)
    outcome = plan_automatically(lake, preset(TICKS), 0, options)
    assert outcome.interrupted
    state, best = RaceState.of(kept[0]), outcome.chosen
    policy = EarlierPolicy(
        config=best.config,
        params=best.params,
        policy_hyperparams=best.policy_hyperparams,
        arm=best.arm,
        label=best.label,
        parents=best.parents,
        uses_noise=best.uses_noise,
        mean=best.mean,
        error=best.error,
    )
    return EarlierRace(state.seconds, policy, (), state, outcome.curve)


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
    return figures["arms"]


def test_a_policy_of_a_race_with_another_time_is_of_the_planner(compiled):
    for kept, fits in (({}, True), ({"cosines": 3}, False)):
        config = compiled.config.with_values("Optimize", train_seconds=7.0)
        config = config.with_policy_arguments(**kept)
        earlier = EarlierPolicy(config, compiled.noop, {}, "a", "b", (), False, 1.0, 0.0)
        assert (earlier.candidate(compiled).planner is compiled.planner) is fits


def in_rounds(state: RaceState) -> bool:
    return state.contenders.get("polishing the weights", {}).get("slices", 0) >= 2


def test_a_race_that_was_stopped_in_an_adaptation_goes_on_with_it(lake):
    def is_adapting(state: RaceState) -> bool:
        return "adaptation" in getattr(state.states.get("shared weights"), "values", {})

    earlier = stopped(lake, is_adapting)
    log = earlier.state.logs["shared weights"]
    assert log.slices == 1
    assert earlier.state.marks["over"] == ["rules"]
    arms = resumed(lake, earlier)
    assert arms["shared weights"]["slices"] >= 2
    assert arms["shared weights"]["iterations"] > log.iterations
    # the no-op and the constants, and no rules again
    assert arms["constants and rules"]["slices"] == 3
    assert arms["constants and rules"]["iterations"] == (
        earlier.state.logs["constants and rules"].iterations
    )


def test_a_race_that_was_stopped_in_its_rounds_goes_on_with_them(lake):
    earlier = stopped(lake, in_rounds)
    over = set(earlier.state.marks["over"])
    assert {"rules", "shared weights"} < over
    logs = earlier.state.logs
    arms = resumed(lake, earlier)
    # it has slices in the rounds, too
    assert arms["shared weights"]["slices"] >= logs["shared weights"].slices
    for name in ("plan", "own weights"):
        assert (name in arms) is (name in logs)
        if name in arms:
            assert arms[name]["slices"] == logs[name].slices
            assert arms[name]["iterations"] == logs[name].iterations
    assert arms["polishing the weights"]["slices"] > logs["polishing the weights"].slices


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


def test_a_race_can_be_stopped_twice(lake):
    earlier = stopped(lake, lambda state: "rules" in state.marks["over"])
    seconds, curve = earlier.seconds, earlier.curve
    assert curve
    earlier = stopped(lake, in_rounds, earlier)
    assert earlier.seconds > seconds
    assert earlier.curve[: len(curve)] == curve
    arms = resumed(lake, earlier)
    assert arms["constants and rules"]["slices"] == 4


def test_what_probing_has_found_is_known(compiled):
    found = type(compiled.probe).of(compiled.probe.state())
    assert found.fits(compiled.planner)
    assert not replace(found, start={"pump": np.zeros(3)}).fits(compiled.planner)
    assert not replace(found, state_scales={"height": (0.0, 1.0)}).fits(compiled.planner)
    assert not replace(found, units={"sluice": 1.0}).fits(compiled.planner)
