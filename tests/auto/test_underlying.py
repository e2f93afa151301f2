"""The second race, for the underlying MDP."""

from types import SimpleNamespace

import pytest
from helpers.lakes import preset
from helpers.levers import NONE, lever_policy
from helpers.toys import toy

from mdpo_rddl.auto import underlying
from mdpo_rddl.auto.options import RaceOptions
from mdpo_rddl.auto.underlying import underlying_seconds, with_underlying
from mdpo_rddl.errors import InputError
from mdpo_rddl.policy.file import SavedTable
from mdpo_rddl.policy.policy import Policy
from mdpo_rddl.policy.table_policy import TablePolicy


def hearing():
    """A policy of the tiger problem, of which nothing is compiled."""
    return Policy(toy("tiger"), preset(1.0), None, {}, {}, seed=5)


@pytest.fixture
def race(monkeypatch):
    """Races that are noted, and give what they are told to."""
    asked = []

    def use(outcome):
        def run(*given):
            asked.append(given)
            if isinstance(outcome, BaseException):
                raise outcome
            return outcome

        monkeypatch.setattr(underlying, "plan_automatically", run)
        return asked

    return use


def test_the_race_is_for_whoever_sees_the_state(race):
    inner = SimpleNamespace(to_saved=lambda: "saved")
    asked = race(SimpleNamespace(interrupted=False, policy=inner))
    policy, config, options = hearing(), preset(3.0), RaceOptions()
    found = with_underlying(policy, config, options)
    assert (found.saved_underlying, found.problem) == ("saved", policy.problem)
    ((problem, *given),) = asked
    assert not problem.model.observ_fluents
    assert given == [config, 5, options]


def test_an_observed_state_needs_none(race):
    asked = race(None)
    policy = lever_policy(NONE)
    assert with_underlying(policy, preset(3.0)) is policy
    assert underlying_seconds(policy.problem, 100.0) == 0.0
    assert underlying_seconds(toy("tiger"), 100.0) == 40.0
    assert asked == []


def test_a_race_that_fails_costs_nothing_but_a_warning(race, caplog):
    race(InputError("it cannot\nbe planned"))
    policy = hearing()
    assert with_underlying(policy, preset(3.0)) is policy
    assert "no policy of the underlying MDP: it cannot be planned" in caplog.text


def test_an_interruption_is_the_whole_runs(race):
    race(SimpleNamespace(interrupted=True, policy=None))
    with pytest.raises(KeyboardInterrupt):
        with_underlying(hearing(), preset(3.0))


def test_a_race_finds_the_optimum_of_whoever_sees_the_tiger():
    found = with_underlying(hearing(), preset(20.0))
    assert isinstance(found.saved_underlying, SavedTable)
    assert isinstance(found.underlying, TablePolicy)
    assert found.underlying.optimum.value == pytest.approx(110.0)
