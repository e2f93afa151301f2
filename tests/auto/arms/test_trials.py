"""The arm that searches by trials: what it offers, and when it gives up."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.lakes import preset
from helpers.toys import toy

from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.arms import trials
from mdpo_rddl.auto.arms.trials import TRIALS, TrialsArm
from mdpo_rddl.auto.outcome.outcome import policy_of
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


def made(problem, model, pulse=lambda: None):
    return TrialsArm(problem, preset(1.0), 0, Ticking(), model, pulse)


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


def test_it_has_a_pulse_between_two_batches(problem, model, monkeypatch):
    monkeypatch.setattr("mdpo_rddl.auto.search.trials.trials._TRIALS", 4)
    batches = []
    arm = made(problem, model, pulse=lambda: batches.append(arm._search.batches))
    arm.work(200.0)
    assert batches == list(range(len(batches)))
    assert len(batches) > 3


def test_what_takes_too_long_to_look_at_costs_the_slice_only(arm, monkeypatch):
    def slow(*arguments, check_time, **others):
        arm._clock.now += 100.0
        check_time()

    with monkeypatch.context() as patched:
        patched.setattr(trials, "play", slow)
        arm.work(100.0)
    assert not arm.take_candidates()
    assert not arm.is_exhausted
    first = arm._closing
    arm.work(arm._clock.now + 200.0)
    (candidate,) = arm.take_candidates()
    # fewer episodes than the 512 tell its return
    assert candidate.table[1].episodes == 128
    assert arm._closing < first


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
