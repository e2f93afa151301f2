"""How a run's time is shared between finding a policy and preparing to think."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from helpers.clocks import Ticking
from helpers.levers import lever_policy
from helpers.toys import toy

from mdpo_rddl import auto
from mdpo_rddl.auto import RaceOptions, RaceOutcome, underlying
from mdpo_rddl.errors import Cancelled
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.session.find import find_by_race
from mdpo_rddl.session.requests import PlanRequest
from mdpo_rddl.session.thinking import choice_times, without_choice


def request(seconds, decision_seconds, problem=None):
    problem = problem or lever_policy().problem
    config = auto_preset("lever").with_values("Optimize", train_seconds=seconds)
    return PlanRequest(
        problem, config, "auto", 0, 2, Path("out"), decision_seconds=decision_seconds
    )


@pytest.mark.parametrize(
    ("seconds", "decision", "kept"),
    [(60.0, 0.0, 0.0), (60.0, 1.0, 15.0), (30.0, 1.0, 8.0), (10.0, 1.0, 5.0), (600.0, 1.0, 60.0)],
)
def test_preparing_to_think_is_within_the_runs_time(seconds, decision, kept):
    asked = request(seconds, decision)
    assert choice_times(asked) == (decision, kept)
    assert without_choice(asked).config.budget().seconds == seconds - kept
    assert asked.config.budget().seconds == seconds


def test_where_the_state_is_hidden_the_choice_has_more():
    assert choice_times(request(60.0, 1.0, toy("tiger"))) == (1.0, 24.0)


@pytest.mark.parametrize(("used", "within"), [(44.0, 16.0), (50.0, 15.0), (5.0, 55.0), (1.0, 59.0)])
def test_what_a_search_has_left_over_is_for_the_choice(used, within):
    assert choice_times(request(60.0, 1.0), used) == (1.0, within)


def test_the_choice_is_never_longer_than_it_may_be():
    assert choice_times(request(60.0, 0.5), used=1.0) == (0.5, 40.0)


class Silent:
    def __init__(self):
        self.stages = []

    def stage(self, name):
        self.stages.append(name)


@pytest.fixture
def raced(monkeypatch):
    """Races of which the seconds are noted, the second one interrupted or not."""

    def use(problem, thinks, interrupted=(False, False), clock=None):
        asked, inner = [], SimpleNamespace(to_saved=lambda: "saved")
        policy = Policy(problem, None, None, {}, {}, seed=5)
        ends = iter(zip((policy, inner), interrupted, strict=True))

        def run(problem, config, *_):
            asked.append((bool(problem.model.observ_fluents), config.budget().seconds))
            found, ended = next(ends)
            rest = {"chosen": None, "judged": (), "arms": (), "probe": None}
            rest |= {"noop_return": None, "random_return": None, "compile_seconds": 0.0}
            return RaceOutcome(found, seconds=1.0, interrupted=ended, **rest)

        for module in (auto, underlying):
            monkeypatch.setattr(module, "plan_automatically", run)
        reporter = Silent()
        options = RaceOptions(clock=clock or Ticking(1.0))
        outcome = find_by_race(request(50.0, 1.0, problem), reporter, options, thinks)
        return asked, outcome, reporter.stages

    return use


def test_a_part_of_the_race_is_for_the_underlying_mdp(raced):
    asked, outcome, stages = raced(toy("tiger"), thinks=True)
    assert asked == [(True, 30.0), (False, 20.0)]
    assert outcome.policy.saved_underlying == "saved"
    # the second race took a second by the clock
    assert (outcome.seconds, outcome.interrupted) == (2.0, False)
    assert stages == ["underlying MDP"]


def test_without_thinking_or_with_an_observed_state_there_is_one_race(raced):
    for problem, thinks in ((toy("tiger"), False), (lever_policy().problem, True)):
        asked, outcome, stages = raced(problem, thinks)
        assert [seconds for _, seconds in asked] == [50.0]
        assert (outcome.policy.saved_underlying, stages) == (None, [])


@pytest.mark.parametrize("interrupted", [(True, False), (False, True)])
def test_an_interruption_ends_both(raced, interrupted):
    asked, outcome, _ = raced(toy("tiger"), True, interrupted)
    assert len(asked) == 1 + interrupted[1]
    assert outcome.interrupted
    assert outcome.policy.saved_underlying is None


def test_cancelled_between_the_two_the_first_is_all(raced):
    def cancelled():
        raise Cancelled

    asked, outcome, _ = raced(toy("tiger"), True, clock=cancelled)
    assert (len(asked), outcome.interrupted) == (1, True)
