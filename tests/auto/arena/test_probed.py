"""Rules by the program of the constants, where the judge's comes too late."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.lakes import preset
from helpers.races import CLOCK, means, raced

from mdpo_rddl import evaluate, make_environment
from mdpo_rddl.auto import RaceOptions
from mdpo_rddl.auto.arena import probed
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.arena.probed import Probed
from mdpo_rddl.auto.outcome.outcome import policy_of
from mdpo_rddl.auto.outcome.unsearched import found_by_probing
from mdpo_rddl.planner.config.fitting import without_scales
from mdpo_rddl.auto.probing.probing import constants_for, probe
from mdpo_rddl.auto.race import affording, race
from mdpo_rddl.planner.build import build_planner

NOOP_RETURN = -2400.0


@pytest.fixture(scope="module")
def clock():
    return Ticking()


@pytest.fixture(scope="module")
def plays(lake, clock):
    config = without_scales(preset(1.0))
    plays = constants_for(build_planner(lake, config).planner, 0, clock=clock)
    probe(plays, 0)
    return Probed(config, plays)


@pytest.fixture
def late_judge(monkeypatch):
    late = property(lambda self: 1e9, lambda self, seconds: None)
    monkeypatch.setattr(Judge, "program_seconds", late, raising=False)


def test_there_is_time_for_a_few_batches_at_least(plays, clock):
    plays.plays.seconds = 10.0
    assert plays.has_time(clock() + 100.0, clock)
    assert not plays.has_time(clock() + 50.0, clock)


def test_few_policies_of_a_batch_are_not_searched(lake, clock):
    planner = build_planner(lake, without_scales(preset(1.0))).planner
    few = constants_for(planner, 0, clock=clock)
    few.size = few.size._replace(at_once=4)
    assert not Probed(preset(1.0), few).has_time(clock() + 1e6, clock)


def test_a_rule_returns_what_is_said_of_it(lake, plays, clock):
    found = plays.best_rule(("an arm", "a rule"), 0, clock() + 2000.0, clock)
    assert (found.arm, found.label, found.config) == ("an arm", "a rule", plays.config)
    assert found.mean > NOOP_RETURN + 1000.0
    assert 0.0 < found.error < 100.0
    played = evaluate(make_environment(lake), policy_of(found, lake, 0), 20, 0).returns
    error = np.hypot(found.error, played.std() / np.sqrt(20))
    assert abs(played.mean() - found.mean) < 4.0 * error


def test_with_hardly_any_time_two_batches_tell_its_error(plays, clock):
    found = plays.best_rule(("an arm", "a rule"), 0, clock(), clock)
    assert np.isfinite(found.error)


@pytest.mark.usefixtures("late_judge", "failing_race")
def test_the_time_that_the_judge_has_no_use_for_is_for_rules(lake, caplog):
    outcome = raced(lake, 1500.0)
    assert "too little time is left to compile the rollouts" in caplog.text
    assert list(means(outcome)) == ["no-op", "constant", "random rule"]
    assert outcome.chosen.label == "random rule"
    assert outcome.chosen.mean > means(outcome)["constant"]
    state, _ = make_environment(lake).reset(seed=0)
    assert outcome.policy(0, state)["pump"] != 0.0


@pytest.mark.usefixtures("late_judge", "failing_race")
def test_an_interrupt_leaves_what_probing_has_found(lake, monkeypatch):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(probed.Probed, "best_rule", interrupted)
    outcome = raced(lake, 1500.0)
    assert outcome.interrupted
    assert outcome.chosen.label == "constant"


@pytest.mark.usefixtures("failing_race")
def test_where_a_search_would_have_little_time_nothing_more_is_compiled(lake, monkeypatch, caplog):
    def refuse(*arguments):
        raise AssertionError("the judge plays nothing")

    monkeypatch.setattr(Judge, "returns_of", refuse)
    monkeypatch.setattr(affording.Affording, "others", lambda self, share: False)
    outcome = raced(lake, 1500.0, RaceOptions(clock=CLOCK))
    assert "too little time to search" in caplog.text
    assert list(means(outcome)) == ["no-op", "constant", "random rule"]
    assert outcome.chosen.mean > means(outcome)["constant"]
    noop, constant, *rules = (judged.candidate for judged in outcome.judged)
    # more rollouts than those of the probing say what they return
    assert min(noop.error, constant.error) > 0.0
    # each is told once
    pumps = [tuple(rule.params["shared"]["pump"]) for rule in rules]
    assert len(set(pumps)) == len(pumps) > 1


def test_the_best_rule_goes_on_between_others():
    """The first search finds 2, the second nothing new, the third 3, the fourth no number."""

    def rule(mean, weight):
        return SimpleNamespace(known_mean=mean, params={"shared": np.array([weight])})

    ends = iter([rule(2.0, 0.0), rule(9.0, 0.0), rule(3.0, 1.0), rule(np.nan, 2.0)])
    begins, left = [], [True] * 5 + [False]

    def best_rule(named, seed, until, clock, begin):
        begins.append(begin and begin["shared"][0])
        return next(ends, rule(1.0, 3.0))

    searches = SimpleNamespace(best_rule=best_rule, has_time=lambda *_: left.pop(0))
    arena = SimpleNamespace(probed=searches, deadline=9.0, clock=None, seed=0, pulse=lambda: None)
    found = [candidate.params["shared"][0] for candidate in found_by_probing(arena)]
    assert found == [0.0, 1.0, 2.0, 3.0]
    assert begins == [None, 0.0, None, 1.0, None]


def test_where_a_population_comes_too_late_rules_are_found_too(lake, monkeypatch, caplog):
    monkeypatch.setattr(affording.Affording, "policies", lambda self: False)
    monkeypatch.setattr(race, "ROLLOUTS", 4)
    outcome = raced(lake, 1500.0, RaceOptions(clock=CLOCK))
    assert "too little time to search" in caplog.text
    assert list(means(outcome)) == ["no-op", "constant", "random rule"]
