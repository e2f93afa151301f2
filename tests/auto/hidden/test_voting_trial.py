"""The vote over the belief: its compilation, and its episodes beside the race's policy."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.clocks import Stopped
from helpers.hidden_courier import idle, planning
from helpers.hidden_races import race_outcome
from helpers.umbrella import careless, voting

from mdpo_rddl.auto.common.compilations import TooLateError
from mdpo_rddl.auto.hidden import voting_trial
from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.exact.exact import LOST
from mdpo_rddl.policy.file import SavedTable


@pytest.fixture
def ready(monkeypatch):
    """How long the vote is waited for; no other policy can be played in time."""
    waited = []

    def once(seconds, call):
        if waited:
            raise TooLateError
        waited.append(seconds)
        return call()

    monkeypatch.setattr(voting_trial, "compiled_within", once)
    return waited


def test_a_trial_that_fails_costs_a_warning(raced, monkeypatch, caplog):
    def failing(*given):
        raise ZeroDivisionError("the simulator\nfails")

    monkeypatch.setattr(voting_trial, "paired_returns", failing)
    found = raced(race_outcome(careless()))
    assert "no vote over the belief: the simulator fails" in caplog.text
    assert (found.outcome.chosen.arm, found.outcome.policy.votes) == ("own weights", False)
    assert found.outcome.arms[0].details == {"cause": "the simulator fails"}


@pytest.mark.usefixtures("ready")
def test_a_vote_that_fails_in_play_is_not_taken_for_an_unknown_policy(raced, monkeypatch):
    monkeypatch.setattr(voting_trial, "paired_returns", lambda *_: np.array([[9.0], [LOST], [9]]))
    first = race_outcome(careless())
    chosen = dataclasses.replace(first.chosen, mean=None, error=np.inf)
    assert not raced(dataclasses.replace(first, chosen=chosen)).outcome.policy.votes


def test_without_time_for_three_episodes_the_policy_plays_alone(raced, monkeypatch):
    two = np.array([[9.0, 1.0], [8.0, 1.0]])
    monkeypatch.setattr(voting_trial, "paired_returns", lambda *_: two)
    found = raced(race_outcome(careless()))
    (log,) = found.outcome.arms
    assert not found.outcome.policy.votes
    assert (log.iterations, log.best_return, found.judged) == (2, None, [])
    assert log.details == {"cause": "no time"}
    # what can think with it has it
    assert isinstance(found.outcome.policy.saved_underlying, SavedTable)


@pytest.mark.parametrize(
    # what the vote returns in three episodes beside what the race says, 1 with an error
    ("returns", "error", "pays"),
    [
        ([3.0, 2.0, 3.0], 0.1, True),
        ([1.3, 1.0, 1.15], 0.1, True),
        ([1.3, 1.0, 1.15], 0.3, False),
        ([0.0, 5.0, -1.0], 0.1, False),
        ([0.9, 0.8, 0.9], 0.1, False),
    ],
)
def test_a_vote_that_takes_long_to_compile_is_compared_with_what_the_race_says(
    raced, monkeypatch, returns, error, pays
):
    clock = Stopped()
    played = []

    def compiled(policy):
        clock.now += 30.0

    def alone(problem, policies, *_):
        played.extend(policy.votes for policy in policies)
        return np.array(returns)[:, np.newaxis]

    monkeypatch.setattr(voting_trial, "_play_steps", compiled)
    monkeypatch.setattr(voting_trial, "paired_returns", alone)
    first = race_outcome(careless())
    first = dataclasses.replace(first, chosen=dataclasses.replace(first.chosen, error=error))
    found = raced(first, clock=clock, takes=55.0)
    (log,) = found.outcome.arms
    assert played == [True]
    assert found.outcome.policy.votes == pays
    assert (log.details, log.compile_seconds) == ({"race_return": 1.0}, 30.0)


@pytest.mark.parametrize(
    # what the probing's program took; None where that was not compiled in time
    "probe",
    [SimpleNamespace(compile_seconds=1000.0), None],
)
def test_nothing_is_compiled_that_would_end_late(raced, probe):
    slow = dataclasses.replace(race_outcome(careless()), probe=probe)
    second = race_outcome(voting().underlying)
    (log,) = raced(slow, second, enumerates=False).outcome.arms
    assert (log.slices, log.details) == (0, {"cause": "no time"})


@pytest.fixture
def too_late(monkeypatch):
    """No vote is compiled in its time."""

    def late(seconds, call):
        raise TooLateError

    monkeypatch.setattr(voting_trial, "compiled_within", late)


def test_where_the_vote_of_an_optimum_is_too_late_the_race_has_what_is_left(raced, too_late):
    found = raced(race_outcome(careless()))
    assert found.asked == [(True, 100.0)]
    (log,) = found.outcome.arms
    assert (log.slices, log.details) == (1, {"cause": "no time"})
    assert not found.outcome.policy.votes
    assert isinstance(found.outcome.policy.saved_underlying, SavedTable)


@pytest.mark.parametrize(
    # what the no-op's episode on the environment says, if there was one; the vote returns 2
    ("mean", "pays"),
    [(1.0, True), (1.9, True), (2.1, False), (None, True)],
)
def test_a_vote_is_compared_with_whatever_is_known_of_a_no_op_that_cannot_be_played_in_time(
    raced, ready, monkeypatch, mean, pays
):
    monkeypatch.setattr(voting_trial, "paired_returns", lambda *_: np.full((3, 1), 2.0))
    first = race_outcome(careless())
    chosen = dataclasses.replace(first.chosen, mean=mean, error=np.inf)
    found = raced(dataclasses.replace(first, chosen=chosen))
    assert found.outcome.policy.votes == pays
    assert found.outcome.arms[0].details == {"race_return": mean}
    # nine tenths of the time are waited for it
    assert ready == [90.0]


def test_a_vote_that_cannot_be_made_is_told_in_one_line(raced, monkeypatch, caplog):
    def refused(*given):
        raise InputError("it reads\nmore than the state")

    monkeypatch.setattr("mdpo_rddl.policy.policy.ActionVoting", refused)
    (log,) = raced(race_outcome(careless())).outcome.arms
    assert "no vote over the belief: it reads more than the state" in caplog.text
    assert log.details == {"cause": "it reads more than the state"}


def test_relaxed_plans_may_vote_too(raced):
    found = raced(race_outcome(idle()), race_outcome(planning()), enumerates=False)
    policy = found.outcome.policy
    assert policy.votes
    assert policy.saved_underlying == planning().to_saved()


def test_nobody_who_does_not_vote_is_given_relaxed_plans(raced, monkeypatch):
    monkeypatch.setattr(voting_trial, "paired_returns", lambda *_: np.array([[0.0, 1.0]] * 3))
    found = raced(race_outcome(idle()), race_outcome(planning()), enumerates=False)
    assert (found.outcome.policy.votes, found.outcome.policy.saved_underlying) == (False, None)
