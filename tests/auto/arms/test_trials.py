"""The arm that searches by trials: what it offers, and when it gives up."""

import json
from dataclasses import replace

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.lakes import preset
from helpers.toys import toy

from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.arms import trials
from mdpo_rddl.auto.arms.trials import TRIALS, TrialsArm
from mdpo_rddl.auto.common.state import UNFIT, State
from mdpo_rddl.auto.outcome.outcome import policy_of
from mdpo_rddl.auto.race.resumption import Resumption
from mdpo_rddl.auto.search.optimum import find_optimum
from mdpo_rddl.auto.search.trials.trials import TrialSearch
from mdpo_rddl.policy.table_policy import TablePolicy
from mdpo_rddl.problem.enumeration.limits import (
    EnumerationLimits,
    NotEnumerableError,
    OutOfTimeError,
)
from mdpo_rddl.problem.enumeration.model import ground_model


@pytest.fixture(scope="module")
def problem():
    return toy("quest")


@pytest.fixture(scope="module")
def model(problem):
    return ground_model(problem, EnumerationLimits(seconds=1e9))


@pytest.fixture
def arm(problem, model):
    return made(problem, model)


def made(problem, model, now=0.0, pulse=lambda: None):
    return TrialsArm(problem, preset(1.0), 0, Ticking(1.0, now), model, pulse)


def test_it_offers_a_table_with_its_simulated_return(arm, problem):
    arm.work(200.0)
    candidates = arm.take_candidates()
    best = candidates[-1]
    optimum = find_optimum(problem, 60.0).value
    assert 0.0 < best.error < 0.2
    assert best.mean == pytest.approx(optimum, abs=4.0 * best.error)
    # of both trusts the better one
    assert len(candidates) == 1
    policy = policy_of(best, problem, 7)
    assert isinstance(policy, TablePolicy)
    assert policy.seed == 7
    assert policy.optimum is None
    assert policy.claim.value == best.mean
    assert policy.claim.missed == 0.0
    assert not arm.is_exhausted
    assert arm.log.details["states"] == policy.claim.states
    assert arm.log.iterations > 0


def test_another_slice_goes_on_and_then_gains_nothing_more(arm):
    for end in range(1, 20):
        if not arm.is_exhausted:
            arm.work(100.0 * end)
            arm.take_candidates()
    assert arm.is_exhausted
    assert arm.log.details["cause"] == "it gains nothing more"
    assert arm.log.slices < 15


def test_it_gives_up_where_every_state_is_new(arm, monkeypatch):
    monkeypatch.setattr(trials, "_MOST_MISSED", -1.0)
    arm.work(100.0)
    assert arm.is_exhausted
    assert arm.log.details["cause"] == "most states are never seen again"
    # what it has found is judged all the same
    assert arm.take_candidates()


def test_few_episodes_tell_where_every_state_is_new(arm, monkeypatch):
    monkeypatch.setattr(trials, "_LOST", -1.0)
    arm.work(100.0)
    assert arm.is_exhausted
    assert arm.log.details["cause"] == "most states are never seen again"
    assert arm.take_candidates() == []


def test_trials_that_were_cut_tell_nothing_of_that(arm, monkeypatch):
    monkeypatch.setattr(trials, "_LOST", -1.0)
    monkeypatch.setattr(TrialSearch, "_from_the_start", lambda self, ends: False)
    arm.work(100.0)
    assert arm.take_candidates()


def test_it_gives_up_where_there_is_no_room(arm, monkeypatch):
    monkeypatch.setattr("mdpo_rddl.auto.search.trials.trials._MOST_STATES", 10)
    arm.work(1e5)
    assert arm.is_exhausted
    assert arm.log.details["cause"] == "no room for more states"


@pytest.mark.parametrize("error", [NotEnumerableError("a law"), MemoryError("much")])
def test_a_failure_is_the_arms_alone(arm, monkeypatch, error):
    def broken(*arguments):
        raise error

    monkeypatch.setattr(trials, "TrialSearch", broken)
    arm.work(100.0)
    assert arm.is_exhausted
    assert str(error) in arm.log.details["cause"]
    assert arm.take_candidates() == []


def test_slices_that_are_too_short_are_not_begun_for_ever(arm):
    arm.work(100.0)
    arm.take_candidates()
    for _ in range(3):
        arm.work(arm._clock.now)
    assert arm.is_exhausted
    assert arm.log.details["cause"] == "its slices are too short"


def test_a_judge_takes_the_better_table_of_one_arm(arm):
    arm.work(100.0)
    best = arm.take_candidates()[-1]
    judge = Judge(1, 0, Ticking(), 0.0)
    worse = replace(best, mean=best.mean - 0.5 * best.error)
    assert judge.record(worse)
    assert judge.record(best)
    assert not judge.record(worse)
    assert judge.incumbent.label == TRIALS


def judged(arm):
    """The means of its candidates, once it was told of them."""
    found = arm.take_candidates()
    for candidate in found:
        arm.judged(candidate)
    return [candidate.mean for candidate in found]


def read(state):
    return State(dict(state.tensors), json.loads(json.dumps(dict(state.values))))


def gone_on_with(arm, problem, model, state=None, pulse=lambda: None):
    """One in another process, which the same time has passed for."""
    other = made(problem, model, arm._clock.now, pulse)
    other.take_over(arm.log, arm.is_over)
    other.restore(read(arm.state()) if state is None else state)
    return other


@pytest.fixture
def _few_trials(monkeypatch):
    monkeypatch.setattr("mdpo_rddl.auto.search.trials.trials._TRIALS", 4)


@pytest.mark.usefixtures("_few_trials")
def test_it_goes_on_in_another_process_as_it_would_have(arm, problem, model):
    assert arm.state() is None
    arm.work(100.0)
    before = judged(arm)
    other = gone_on_with(arm, problem, model)
    # until it is asked to work it has what it was given
    assert other.state().values == arm.state().values
    # restoring takes time, which is not the search's
    assert other._begun(1e9, 0.0) is not None
    other.prepare()
    other._clock.now = arm._clock.now
    for each in (arm, other):
        each.work(250.0)
    after = judged(arm)
    assert judged(other) == after
    assert not after or min(after) > max(before)
    assert other.log.iterations == arm.log.iterations > 1
    assert other.log.details == arm.log.details
    one, same = arm.state().part("search"), other.state().part("search")
    np.testing.assert_array_equal(one.tensors["explored/tried"], same.tensors["explored/tried"])


@pytest.mark.usefixtures("_few_trials")
def test_what_was_not_judged_is_found_again_by_one_that_had_given_up(
    arm, problem, model, monkeypatch
):
    monkeypatch.setattr(trials, "_MOST_MISSED", -1.0)
    resumption = Resumption(lambda: 0.0)
    resumption.enter(arm)
    arm.work(100.0)
    assert arm.is_exhausted
    left = resumption.snapshot()
    assert left.exhausted == frozenset()
    other = gone_on_with(arm, problem, model)
    means = judged(arm)
    # now there is nothing that could be lost
    assert arm.state() is None
    assert resumption.snapshot().exhausted == {TRIALS}
    other.work(other._clock.now + 100.0)
    assert judged(other)[-1] >= means[-1]


@pytest.mark.usefixtures("_few_trials")
def test_what_takes_longer_than_a_slice_is_restored_in_several(arm, problem, model, monkeypatch):
    monkeypatch.setattr("mdpo_rddl.auto.search.trials.explored._ROWS_TOGETHER", 1)
    arm.work(100.0)
    judged(arm)
    pulses = []
    other = gone_on_with(arm, problem, model, pulse=lambda: pulses.append(other.state()))
    given = other.state()
    parts = len(given.tensors["search/explored/batches"]) - 1
    before = other.log.iterations
    for _ in range(100):
        other.work(other._clock.now + 30.0)
        if other.state() is not given:
            break
        assert other.log.iterations == before
    assert other.log.slices > arm.log.slices + 1
    assert [each is given for each in pulses[:parts]] == [True] * parts
    assert not other.is_exhausted


@pytest.mark.parametrize("name", ["search/explored/visits", "search/policy/choices"])
@pytest.mark.usefixtures("_few_trials")
def test_a_state_that_does_not_fit_costs_the_state_only(arm, problem, model, name, caplog):
    caplog.set_level("INFO")
    arm.work(100.0)
    judged(arm)
    state = read(arm.state())
    state.tensors[name] = state.tensors[name][:1]
    other = gone_on_with(arm, problem, model, state)
    other.work(other._clock.now + 500.0)
    assert f"{TRIALS}: its state is left out: " in caplog.text
    assert not other.is_exhausted
    assert other.take_candidates()


@pytest.mark.parametrize(
    "values", [{"closing": -1.0}, {"closing": "?"}, {"without_gain": 0.5}, {"search": None}]
)
@pytest.mark.usefixtures("_few_trials")
def test_a_place_that_is_none_is_refused_at_once(arm, problem, model, values):
    arm.work(100.0)
    state = arm.state()
    with pytest.raises(UNFIT):
        made(problem, model).restore(State(state.tensors, {**state.values, **values}))


@pytest.mark.usefixtures("_few_trials")
def test_its_state_can_be_asked_for_between_two_batches(problem, model):
    states = []
    arm = made(problem, model, pulse=lambda: states.append(arm.state()))
    arm.work(200.0)
    batches = [state.part("search").values["batches"] for state in states]
    assert batches == list(range(len(states)))
    assert len(states) > 3


def test_what_takes_too_long_to_look_at_costs_the_slice_only(arm, monkeypatch):
    def slow(*arguments, check_time, **others):
        arm._clock.now += 100.0
        check_time()

    with monkeypatch.context() as patched:
        patched.setattr(trials, "play", slow)
        arm.work(100.0)
    assert not arm.take_candidates()
    assert not arm.is_exhausted
    first = arm.state().values["closing"]
    arm.work(arm._clock.now + 200.0)
    (candidate,) = arm.take_candidates()
    # fewer episodes than the 512 tell its return
    assert candidate.table[1].episodes == 128
    assert arm.state().values["closing"] < first


def test_a_law_that_is_none_ends_the_arm_with_its_cause_however_late_it_is_met(arm, monkeypatch):
    def broken(*arguments, **others):
        raise NotEnumerableError("a probability outside of [0, 1]")

    monkeypatch.setattr(trials, "play", broken)
    arm.work(100.0)
    assert arm.is_exhausted
    assert arm.log.details["cause"] == "a probability outside of [0, 1]"
    assert arm.log.slices == 1


def test_the_return_that_is_told_is_of_episodes_that_it_was_not_chosen_by(arm, monkeypatch):
    played = []

    def noted(explored, greedy, episodes, seed, fresh=False, check_time=None):
        played.append((fresh, greedy, play(explored, greedy, episodes, seed, fresh)))
        return played[-1][2]

    play = trials.play
    monkeypatch.setattr(trials, "play", noted)
    arm.work(200.0)
    (candidate,) = arm.take_candidates()
    # a few episodes tell whether to go on
    assert [fresh for fresh, _, _ in played] == [False, False, False, True]
    chosen = max(played[1:3], key=lambda one: one[2].returns.mean())
    fresh = played[3]
    assert fresh[1] is chosen[1]
    assert candidate.mean == fresh[2].returns.mean() == candidate.table[1].value
    assert not np.array_equal(fresh[2].returns, chosen[2].returns)


def test_a_known_value_that_is_no_number_is_refused(arm, problem, model):
    arm.work(200.0)
    state = arm.state()
    other = made(problem, model)
    with pytest.raises(ValueError, match="is known"):
        other.restore(replace(state, values={**state.values, "known": float("nan")}))
    other.restore(state)
    assert other.progress == arm.progress > 0.0


def test_a_slice_too_short_to_make_its_model_is_not_the_last(arm, monkeypatch):
    def late(*arguments):
        raise OutOfTimeError("more than 4 s")

    with monkeypatch.context() as patch:
        patch.setattr(trials, "TrialSearch", late)
        arm.work(100.0)
        assert not arm.is_exhausted
        other = made(arm._problem, arm._model)
        other.work(100.0)
        other.work(250.0)
    assert other.is_exhausted
    assert "more than 4 s" in other.log.details["cause"]
    arm.work(400.0)
    assert arm.take_candidates()
