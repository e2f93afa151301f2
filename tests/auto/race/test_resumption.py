"""A race goes on with what the arms of another one have left."""

import json

import numpy as np
import pytest
from helpers.clocks import Stopped

from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.common.arm_log import ArmLog
from mdpo_rddl.auto.common.state import UNFIT, State
from mdpo_rddl.auto.probing.probing import Probe
from mdpo_rddl.auto.race.resumption import Resumption
from mdpo_rddl.auto.race.rounds import Contender
from mdpo_rddl.auto.resuming import race_state
from mdpo_rddl.auto.resuming.race_state import RaceState
from mdpo_rddl.planner.training.training import Record


class Counting(Arm):
    """Counts its iterations, from what it has counted in another process."""

    def __init__(self, name: str = "counting") -> None:
        super().__init__(name, Stopped())
        self.counted = np.zeros(2)

    def _work(self, until: float) -> None:
        self.counted += 1.0
        self._log.iterations += 1

    def state(self) -> State:
        return State({"counted": self.counted}, {"why": "to test"})

    def restore(self, state: State) -> None:
        self.counted = state.array("counted", (2,))


class Plain(Counting):
    """Has no state, as most arms."""

    def state(self) -> None:
        """Nothing."""


PROBE = Probe(
    units={"pump": 3.0},
    state_scales={"depth": (1.0, 2.0)},
    noop_return=-7.0,
    start={"pump": np.array([0.5, 1.0])},
    start_return=-3.0,
    deterministic=False,
    certain=False,
    policy_seconds=None,
)


def written(state: RaceState) -> State:
    flat = state.flat()
    return State(dict(flat.tensors), json.loads(json.dumps(dict(flat.values))))


def left() -> RaceState:
    """What a race leaves after two slices of one arm and one of another."""
    resumption = Resumption(lambda: 40.0)
    resumption.probe = PROBE
    first, second = Counting(), Plain("plain")
    for arm in (first, second, first):
        resumption.enter(arm)
        arm.work(1.0)
    second.is_exhausted = True
    contender = Contender(first, lambda: None)
    resumption.contend(contender)
    contender.slices, contender.pace, contender.waited = 2, 0.5, 1
    resumption.marks.ended("rules")
    return RaceState.of(written(resumption.snapshot()))


def test_all_of_it_comes_back():
    state = left()
    assert state.seconds == 40.0
    assert state.marks["over"] == ["rules"]
    assert state.exhausted == {"plain"}
    assert sorted(state.states) == ["counting"]
    assert state.probe.units == PROBE.units
    assert state.probe.state_scales == PROBE.state_scales
    np.testing.assert_array_equal(state.probe.start["pump"], PROBE.start["pump"])
    resumption = Resumption(lambda: 41.0, state)
    arm = Counting()
    resumption.enter(arm)
    assert (arm.log.slices, arm.log.iterations) == (2, 2)
    np.testing.assert_array_equal(arm.counted, [2.0, 2.0])
    assert state.states == {}  # the arm has it
    assert sorted(resumption.snapshot().states) == ["counting"]
    arm.work(1.0)
    np.testing.assert_array_equal(arm.counted, [3.0, 3.0])
    contender = Contender(arm, lambda: None)
    resumption.contend(contender)
    assert (contender.slices, contender.pace, contender.waited) == (2, 0.5, 1)


def test_what_no_arm_has_taken_over_stays_for_the_race_after_the_next():
    resumption = Resumption(lambda: 41.0, left())
    plain = Plain("plain")
    resumption.enter(plain)
    assert plain.is_exhausted
    assert not resumption.goes_on("plain")
    assert resumption.goes_on("counting")
    assert [log.name for log in resumption.left_out([plain])] == ["counting"]
    again = RaceState.of(written(resumption.snapshot()))
    np.testing.assert_array_equal(again.states["counting"].tensors["counted"], [2.0, 2.0])
    assert again.logs["counting"].slices == 2
    assert again.contenders["counting"]["slices"] == 2
    assert again.exhausted == {"plain"}


def test_a_state_that_does_not_fit_is_left_out_and_said(caplog):
    caplog.set_level("INFO")
    state = left()
    state.states["counting"].tensors["counted"] = np.zeros(3)
    arm = Counting()
    Resumption(lambda: 0.0, state).enter(arm)
    np.testing.assert_array_equal(arm.counted, np.zeros(2))
    assert "counting: its state is left out: its counted is float64[3]" in caplog.text


def test_an_arm_that_cannot_tell_its_state_does_not_cost_the_race(monkeypatch, caplog):
    def broken(arm):
        raise RuntimeError("no state")

    monkeypatch.setattr(Counting, "state", broken)
    resumption = Resumption(lambda: 3.0)
    resumption.enter(Counting())
    assert resumption.snapshot().states == {}
    assert "its state is not kept: no state" in caplog.text


def test_states_that_are_too_large_are_left_out(monkeypatch):
    big, small = State({"x": np.zeros(100)}), State({"x": np.zeros(10)})
    state = RaceState(1.0, states={"big": big, "small": small})
    assert sorted(RaceState.of(written(state)).states) == ["big", "small"]
    monkeypatch.setattr(race_state, "MOST_ARM_BYTES", 799)
    assert sorted(RaceState.of(written(state)).states) == ["small"]
    monkeypatch.setattr(race_state, "MOST_ARM_BYTES", 800)
    monkeypatch.setattr(race_state, "MOST_BYTES", 879)
    assert sorted(RaceState.of(written(state)).states) == ["small"]


@pytest.mark.parametrize(
    "change",
    [
        lambda race: race.pop("logs"),
        lambda race: race.update(seconds=float("nan")),
        lambda race: race.update(marks=3),
        lambda race: race["logs"]["counting"].update(slices=-1),
        lambda race: race["logs"]["counting"].update(details=3),
        lambda race: race["contenders"]["counting"].update(pace="fast"),
    ],
)
def test_a_damaged_state_is_refused(change):
    flat = written(left())
    change(flat.values["race"])
    with pytest.raises(UNFIT):
        RaceState.of(flat)


def test_a_probe_whose_units_are_none_is_refused():
    state = PROBE.state()
    for units in ({"pump": 0.0}, {"pump": float("inf")}, {"pump": None}, 3):
        with pytest.raises(UNFIT):
            Probe.of(State(state.tensors, {**state.values, "units": units}))


def test_a_log_keeps_no_iterations():
    record = Record(iteration=0, train_return=-2.0, test_return=-1.0, mean_sigma=0.5)
    log = ArmLog("slp", slices=2, seconds=3.0, best_return=None, details={"cause": "x"})
    log.records, log.sigma = (record,), np.ones((1, 7))
    back = RaceState.of(written(RaceState(1.0, logs={"slp": log}))).logs["slp"]
    assert (back.slices, back.seconds, back.best_return) == (2, 3.0, None)
    assert back.details == {"cause": "x"}
    # they may be many
    assert (back.records, back.sigma) == ((), None)
    assert written(RaceState(1.0, logs={"slp": log})).tensors == {}
