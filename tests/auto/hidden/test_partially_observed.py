"""The race where the state is hidden, the underlying MDP, and the vote over the belief."""

import dataclasses
import logging
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.clocks import Stopped
from helpers.hidden_races import LONG, race_outcome
from helpers.lakes import preset
from helpers.levers import NONE, lever_policy
from helpers.tiger import listener
from helpers.toys import toy
from helpers.umbrella import careless, voting

from mdpo_rddl.auto import RaceOptions, plan_automatically
from mdpo_rddl.auto.hidden import partially_observed
from mdpo_rddl.auto.hidden.voting_trial import VotingTrial
from mdpo_rddl.errors import Cancelled, InputError
from mdpo_rddl.policy.file import SavedTable
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment


def test_an_observed_state_needs_one_race(monkeypatch):
    asked, policy = [], lever_policy(NONE)
    monkeypatch.setattr(
        "mdpo_rddl.auto.planning.run_race", lambda *given: asked.append(given) or "outcome"
    )
    options = RaceOptions()
    assert plan_automatically(policy.problem, LONG, 3, options) == "outcome"
    assert asked == [(policy.problem, LONG, 3, options)]


def test_the_vote_is_taken_where_it_returns_more(raced):
    found = raced(race_outcome(careless()))
    # the underlying MDP's states are enumerated, and no race is for them
    # 15 s for the vote's episodes
    assert (found.asked, found.latest) == ([(True, 85.0)], [-np.inf])
    assert found.stages == ["enumerating", "underlying MDP", "underlying MDP"]
    outcome = found.outcome
    assert outcome.policy.votes
    assert (outcome.chosen.arm, outcome.chosen.label) == ("action voting", "vote over the belief")
    assert [one.became_incumbent for one in found.judged] == [True]
    (log,) = outcome.arms
    assert log.best_return == outcome.chosen.mean == found.judged[0].candidate.mean
    assert log.best_return > log.details["race_return"] + 2.0
    assert outcome.policy.candidates[-1]["candidate"] == "vote over the belief"
    assert not outcome.interrupted


def test_it_is_taken_where_it_knows_what_a_mistake_costs(raced):
    found = raced(race_outcome(listener()))
    assert found.outcome.policy.votes
    # listening eleven times returns -11
    assert found.outcome.chosen.mean > 0.0


def test_it_is_not_where_it_returns_less(raced, monkeypatch):
    monkeypatch.setattr("mdpo_rddl.auto.search.optimum._MOST_VALUES", 0)
    # whoever counts votes opens a door at once, and is eaten
    found = raced(race_outcome(listener()))
    outcome = found.outcome
    assert not outcome.policy.votes
    assert isinstance(outcome.policy.saved_underlying, SavedTable)
    assert outcome.chosen.arm == "own weights"
    assert outcome.arms[0].best_return < outcome.arms[0].details["race_return"]
    assert [one.became_incumbent for one in found.judged] == [False]


def test_where_states_cannot_be_enumerated_a_second_race_is_for_who_sees_them(raced):
    second = race_outcome(voting().underlying)
    found = raced(race_outcome(careless()), second, enumerates=False)
    # 15 s for the vote, six tenths of the rest for the second race; the stopped clock leaves it all
    assert found.asked == [(True, 34.0), (False, 85.0)]
    assert found.lefts == [[], ["dynamic programming", "relaxed plans"]]
    assert found.latest == [100.0, -np.inf]
    assert found.outcome.policy.votes


@pytest.mark.parametrize(("noop", "plans"), [(0.5, False), (1.0, True), (2.0, True)])
def test_relaxed_plans_are_for_where_nothing_else_was_found(raced, noop, plans):
    first = dataclasses.replace(race_outcome(careless()), noop_return=noop)
    found = raced(first, race_outcome(voting().underlying), enumerates=False)
    assert ("relaxed plans" not in found.lefts[1]) == plans


def test_relaxed_plans_are_left_out_where_their_vote_would_be_too_late(raced, monkeypatch):
    monkeypatch.setattr(partially_observed, "_PLANS_SECONDS", 85.5)
    first = dataclasses.replace(race_outcome(careless()), noop_return=2.0)
    found = raced(first, race_outcome(voting().underlying), enumerates=False)
    assert "relaxed plans" in found.lefts[1]


def test_a_first_race_that_takes_all_of_the_time_is_the_only_one(raced):
    found = raced(race_outcome(careless()), enumerates=False, clock=Stopped())
    assert found.asked == [(True, 34.0)]
    assert (found.outcome.chosen.arm, found.outcome.seconds) == ("own weights", 100.0)


def test_a_second_race_that_fails_costs_nothing_but_a_warning(raced, caplog):
    error = InputError("it cannot\nbe planned")
    found = raced(race_outcome(careless()), error, enumerates=False)
    assert "no policy of the underlying MDP: it cannot be planned" in caplog.text
    assert (found.outcome.policy.votes, found.outcome.chosen.arm) == (False, "own weights")
    assert found.outcome.policy.saved_underlying is None


@pytest.mark.parametrize("end", [KeyboardInterrupt(), Cancelled(), None])
def test_an_interruption_of_the_second_race_keeps_the_first(raced, end):
    second = end or race_outcome(voting().underlying, interrupted=True)
    found = raced(race_outcome(careless()), second, enumerates=False)
    assert (len(found.asked), found.outcome.interrupted) == (2, True)
    assert found.outcome.policy.saved_underlying is None


def test_an_interruption_of_the_first_race_ends_all(raced):
    found = raced(race_outcome(careless(), interrupted=True))
    assert found.outcome.interrupted
    # what was planned before is kept for thinking
    assert isinstance(found.outcome.policy.saved_underlying, SavedTable)
    (log,) = found.outcome.arms
    assert (log.name, log.slices, log.iterations) == ("action voting", 1, 0)
    assert not found.outcome.policy.votes


@pytest.mark.parametrize("stop", [KeyboardInterrupt(), Cancelled()])
def test_a_stop_before_the_race_has_anything_leaves_the_no_op(raced, monkeypatch, stop):
    def stopped(*given):
        raise stop

    first = race_outcome(careless())
    monkeypatch.setattr(VotingTrial, "compile_before", lambda *given: None)
    monkeypatch.setattr(partially_observed, "run_race", stopped)
    options = RaceOptions(clock=Stopped())
    outcome = plan_automatically(first.policy.problem, LONG, 0, options)
    assert (outcome.interrupted, outcome.chosen.label) == (True, "no-op")
    assert outcome.noop_return == outcome.chosen.mean


def test_the_vote_can_be_left_out(raced):
    found = raced(race_outcome(careless()), without=["action voting"])
    assert (found.asked, found.stages) == ([(True, 100.0)], [])


def test_where_the_environment_fails_all_of_the_time_is_the_races(raced, monkeypatch):
    monkeypatch.setattr(
        partially_observed, "watched", lambda problem, _: dataclasses.replace(problem, raises=True)
    )
    # what an error costs is not known there
    found = raced(race_outcome(careless()))
    assert (found.asked, found.stages) == ([(True, 100.0)], [])
    assert not found.outcome.policy.votes


def test_a_vote_that_knows_what_an_error_costs_may_be_taken(raced, monkeypatch):
    seen, optimum = [], voting().underlying
    monkeypatch.setattr(
        partially_observed, "watched", lambda problem, _: dataclasses.replace(problem, raises=True)
    )
    monkeypatch.setattr(
        partially_observed,
        "underlying_optimum",
        lambda problem, *_: seen.append(problem.raises) or optimum,
    )
    found = raced(race_outcome(careless()))
    assert (seen, found.asked) == ([True], [(True, 85.0)])
    assert found.outcome.policy.votes


def test_without_an_underlying_mdp_all_of_the_time_is_the_races(raced, monkeypatch, caplog):
    def refused(problem):
        raise InputError("it is no problem\nwithout what is observed")

    monkeypatch.setattr(partially_observed, "underlying_mdp", refused)
    found = raced(race_outcome(careless()))
    assert (found.asked, found.stages) == ([(True, 100.0)], [])
    assert "no underlying MDP: it is no problem without what is observed" in caplog.text


@pytest.mark.parametrize("stop", [KeyboardInterrupt(), Cancelled()])
def test_a_stop_before_the_race_leaves_the_no_op(raced, monkeypatch, stop):
    def stopped(*given):
        raise stop

    monkeypatch.setattr(partially_observed, "underlying_optimum", stopped)
    found = raced(race_outcome(careless()))
    assert (found.asked, found.outcome.interrupted) == ([], True)
    assert (found.outcome.chosen.label, found.outcome.policy.votes) == ("no-op", False)


def test_a_stop_before_the_race_that_goes_on_leaves_it_to_the_next_one(raced, monkeypatch):
    def stopped(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr(partially_observed, "underlying_optimum", stopped)
    earlier = SimpleNamespace(seconds=1.0)
    with pytest.raises(KeyboardInterrupt):
        raced(race_outcome(careless()), earlier=earlier)


@pytest.mark.long
def test_the_whole_plays_as_well_as_who_counts(caplog):
    caplog.set_level(logging.WARNING)
    outcome = plan_automatically(toy("umbrella"), preset(25.0), 0)
    assert {"constants and rules", "action voting"} <= {log.name for log in outcome.arms}
    # the rule remembers what it has heard, so that both may play alike
    voted = outcome.arms[-1]
    assert voted.best_return == pytest.approx(voted.details["race_return"], abs=2.0)
    env = make_environment(toy("umbrella"))
    found, alone = (evaluate(env, p, 50, 0).mean for p in (outcome.policy, careless()))
    assert found > alone + 2.0
