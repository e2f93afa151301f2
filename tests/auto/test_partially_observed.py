"""The race where the state is hidden, the underlying MDP, and the vote over the belief."""

import dataclasses
import logging
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.clocks import Stopped
from helpers.lakes import preset
from helpers.levers import NONE, lever_policy
from helpers.tiger import listener
from helpers.toys import toy
from helpers.umbrella import careless, voting

from mdpo_rddl.auto import (
    RaceOptions,
    RaceOutcome,
    partially_observed,
    plan_automatically,
    voting_trial,
)
from mdpo_rddl.auto.arms.dynamic_programming import DynamicProgrammingArm
from mdpo_rddl.auto.candidate import Candidate
from mdpo_rddl.auto.compilations import TooLateError
from mdpo_rddl.auto.voting_trial import VotingTrial
from mdpo_rddl.errors import Cancelled, InputError
from mdpo_rddl.planner.exact import LOST
from mdpo_rddl.policy.file import SavedTable
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment

LONG = preset(100.0)


def race_outcome(policy, interrupted=False):
    """Of a race that found the policy in a second."""
    candidate = Candidate("own weights", "own weights", LONG, None, {}, mean=1.0)
    rest = {"noop_return": None, "random_return": None, "compile_seconds": 0.25}
    probe = SimpleNamespace(compile_seconds=0.25)
    ended = {"seconds": 1.0, "interrupted": interrupted}
    return RaceOutcome(policy, candidate, (), [], probe=probe, **ended, **rest)


@pytest.fixture
def raced(monkeypatch):
    """Plans with races of which the seconds are noted, and which give what they are told to."""

    def use(first, second=None, without=(), enumerates=True, clock=None, takes=0.0, earlier=None):
        asked, lefts, latest, ends = [], [], [], iter((first, second))

        def run(problem, config, seed, options):
            asked.append((bool(problem.model.observ_fluents), config.budget().seconds))
            lefts.append(config.section("Search")["without"])
            latest.append(options.at_the_latest)
            if clock is not None:
                clock.now = max(clock.now + takes, options.at_the_latest)
            end = next(ends)
            if isinstance(end, BaseException):
                raise end
            return end

        monkeypatch.setattr(partially_observed, "run_race", run)
        if not enumerates:
            monkeypatch.setattr(partially_observed, "is_discrete", lambda problem: False)
        stages, judged = [], []
        options = RaceOptions(
            on_stage=stages.append,
            on_judged=judged.append,
            clock=clock or Stopped(),
            earlier=earlier,
        )
        problem = first.policy.problem
        config = LONG.with_values("Search", without=[*without])
        outcome = plan_automatically(problem, config, 0, options)
        told = {"outcome": outcome, "stages": stages, "judged": judged}
        return SimpleNamespace(asked=asked, lefts=lefts, latest=latest, **told)

    return use


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
    monkeypatch.setattr("mdpo_rddl.auto.optimum._MOST_VALUES", 0)
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


def test_a_trial_that_fails_costs_a_warning(raced, monkeypatch, caplog):
    def failing(*given):
        raise ZeroDivisionError("the simulator\nfails")

    monkeypatch.setattr(voting_trial, "paired_returns", failing)
    found = raced(race_outcome(careless()))
    assert "no vote over the belief: the simulator fails" in caplog.text
    assert (found.outcome.chosen.arm, found.outcome.policy.votes) == ("own weights", False)
    assert found.outcome.arms[0].details == {"cause": "the simulator fails"}


def test_a_vote_that_fails_in_play_is_not_taken_for_an_unknown_policy(raced, monkeypatch):
    ready = []

    def once(seconds, call):
        if ready:
            raise TooLateError
        ready.append(seconds)
        return call()

    monkeypatch.setattr(voting_trial, "compiled_within", once)
    monkeypatch.setattr(voting_trial, "paired_returns", lambda *_: np.array([[9.0], [LOST], [9]]))
    first = race_outcome(careless())
    chosen = dataclasses.replace(first.chosen, mean=None, error=np.inf)
    assert not raced(dataclasses.replace(first, chosen=chosen)).outcome.policy.votes


def test_the_vote_can_be_left_out(raced):
    found = raced(race_outcome(careless()), without=["action voting"])
    assert (found.asked, found.stages) == ([(True, 100.0)], [])


@pytest.mark.parametrize(("deadline", "until"), [(500.0, 25.0), (5.0, 5.0)])
def test_the_optimum_has_a_share_of_the_time_that_is_left(monkeypatch, deadline, until):
    asked = []
    monkeypatch.setattr(DynamicProgrammingArm, "work", lambda arm, until: asked.append(until))
    options, underlying = RaceOptions(clock=Stopped()), voting().underlying.problem
    found = partially_observed._optimum(underlying, LONG, 0, options, deadline)
    assert (found, asked) == (None, [until])


def test_where_the_environment_fails_all_of_the_time_is_the_races(raced, monkeypatch):
    monkeypatch.setattr(
        partially_observed, "watched", lambda problem, _: dataclasses.replace(problem, raises=True)
    )
    found = raced(race_outcome(careless()))
    assert (found.asked, found.stages) == ([(True, 100.0)], [])


def test_without_an_underlying_mdp_all_of_the_time_is_the_races(raced, monkeypatch, caplog):
    def refused(problem):
        raise InputError("it is no problem\nwithout what is observed")

    monkeypatch.setattr(partially_observed, "underlying_mdp", refused)
    found = raced(race_outcome(careless()))
    assert (found.asked, found.stages) == ([(True, 100.0)], [])
    assert "no underlying MDP: it is no problem without what is observed" in caplog.text


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
    raced, monkeypatch, mean, pays
):
    ready = []

    def once(seconds, call):
        if ready:
            raise TooLateError
        ready.append(seconds)
        return call()

    monkeypatch.setattr(voting_trial, "compiled_within", once)
    monkeypatch.setattr(voting_trial, "paired_returns", lambda *_: np.full((3, 1), 2.0))
    first = race_outcome(careless())
    chosen = dataclasses.replace(first.chosen, mean=mean, error=np.inf)
    found = raced(dataclasses.replace(first, chosen=chosen))
    assert found.outcome.policy.votes == pays
    assert found.outcome.arms[0].details == {"race_return": mean}
    # nine tenths of the time are waited for it
    assert ready == [90.0]


@pytest.mark.parametrize("stop", [KeyboardInterrupt(), Cancelled()])
def test_a_stop_before_the_race_leaves_the_no_op(raced, monkeypatch, stop):
    def stopped(*given):
        raise stop

    monkeypatch.setattr(partially_observed, "_optimum", stopped)
    found = raced(race_outcome(careless()))
    assert (found.asked, found.outcome.interrupted) == ([], True)
    assert (found.outcome.chosen.label, found.outcome.policy.votes) == ("no-op", False)


def test_a_stop_before_the_race_that_goes_on_leaves_it_to_the_next_one(raced, monkeypatch):
    def stopped(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr(partially_observed, "_optimum", stopped)
    earlier = SimpleNamespace(seconds=1.0)
    with pytest.raises(KeyboardInterrupt):
        raced(race_outcome(careless()), earlier=earlier)


def test_a_vote_that_cannot_be_made_is_told_in_one_line(raced, monkeypatch, caplog):
    def refused(*given):
        raise InputError("it reads\nmore than the state")

    monkeypatch.setattr("mdpo_rddl.policy.policy.ActionVoting", refused)
    (log,) = raced(race_outcome(careless())).outcome.arms
    assert "no vote over the belief: it reads more than the state" in caplog.text
    assert log.details == {"cause": "it reads more than the state"}


@pytest.mark.long
def test_the_whole_plays_as_well_as_who_counts(caplog):
    caplog.set_level(logging.WARNING)
    outcome = plan_automatically(toy("umbrella"), preset(25.0), 0)
    assert {"constants and rules", "action voting"} <= {log.name for log in outcome.arms}
    assert outcome.seconds < 30.0
    # the rule remembers what it has heard, so that both may play alike
    voted = outcome.arms[-1]
    assert voted.best_return == pytest.approx(voted.details["race_return"], abs=2.0)
    env = make_environment(toy("umbrella"))
    found, alone = (evaluate(env, p, 50, 0).mean for p in (outcome.policy, careless()))
    assert found > alone + 2.0
