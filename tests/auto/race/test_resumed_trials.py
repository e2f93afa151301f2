"""A race that is stopped while it enumerates, or in its trials, goes on with what they saw."""

import json
from dataclasses import replace

import pytest
from helpers.clocks import Ticking
from helpers.lakes import preset
from helpers.toys import toy

from mdpo_rddl.auto import RaceOptions, plan_automatically
from mdpo_rddl.auto.arms.dynamic_programming import DynamicProgrammingArm
from mdpo_rddl.auto.arms.trials import TRIALS
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.state import State
from mdpo_rddl.auto.race import race
from mdpo_rddl.auto.race.ground_arms import GroundSlices
from mdpo_rddl.auto.resuming.earlier import EarlierPolicy, EarlierRace
from mdpo_rddl.auto.resuming.race_state import RaceState
from mdpo_rddl.policy.table_policy import TablePolicy

TICKS = 3000.0
NOOP = Candidate("rules", "no-op", preset(TICKS), object(), {}, mean=0.0)


class Races:
    """Races of a problem that are stopped in their probing, and what they have done.

    Attributes:
      places: where they were at each pulse, as it comes out of a file, with the latest event.
      trials: the arms that have searched by trials.
    """

    def __init__(self, monkeypatch):
        self.events, self.places, self.trials = [], [], []
        begin = GroundSlices._begin

        def enumerated(arm, until):
            self.events.append("enumerated")
            arm.ground(until)

        def begun(slices, trials, deadline):
            begin(slices, trials, deadline)
            self.trials.append(trials)

        def probed(*arguments):
            raise KeyboardInterrupt

        monkeypatch.setattr(DynamicProgrammingArm, "_work", enumerated)
        monkeypatch.setattr(GroundSlices, "_begin", begun)
        monkeypatch.setattr(race, "_arena", probed)
        monkeypatch.setattr(race, "first_policy", lambda *arguments: NOOP)
        monkeypatch.setattr("mdpo_rddl.auto.search.trials.trials._TRIALS", 8)
        monkeypatch.setattr("mdpo_rddl.auto.arms.trials._EPISODES", 64)

    def run(self, earlier=None):
        snapshots = []

        def pulse():
            flat = snapshots[0]().flat()
            flat = State(dict(flat.tensors), json.loads(json.dumps(dict(flat.values))))
            self.places.append((self.events[-1], RaceState.of(flat)))

        options = RaceOptions(
            clock=Ticking(),
            earlier=earlier,
            on_stage=self.events.append,
            on_begun=snapshots.append,
            on_pulse=pulse,
        )
        config = preset(TICKS).with_values("Search", without=["relaxed plans"])
        return plan_automatically(toy("quest"), config, 0, options)

    def resume(self, state):
        """Goes on from a place, whose policies are of no interest here."""
        state = replace(state, states=dict(state.states))  # they are taken out of it
        first = EarlierPolicy(preset(TICKS), {}, {}, "rules", "no-op", (), False, 0.0, 1.0)
        with pytest.raises(KeyboardInterrupt):
            self.run(EarlierRace(state.seconds, first, (), state))
        return self.trials[-1]


@pytest.fixture
def races(monkeypatch):
    return Races(monkeypatch)


@pytest.fixture(scope="module")
def first():
    """A race, and what it has come to."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        races = Races(monkeypatch)
        return races.run(), races.places


def batches(state: RaceState) -> int:
    """That the trials had played."""
    return state.states[TRIALS].part("search").values["batches"]


def test_a_race_goes_on_with_its_trials(first, races):
    outcome, places = first
    assert isinstance(outcome.policy, TablePolicy)
    assert outcome.chosen.mean > 1.0
    names = [event for event, _ in places]
    # before the states are enumerated, between batches of trials, and before probing
    assert (names[0], names[-1]) == ("enumerating", "probing")
    middle = [state for event, state in places if event == "searching"]
    assert [batches(state) for state in middle[1:4]] == [1, 2, 3]
    # in the middle of the trials nothing is lost, and nothing enumerated again
    trials = races.resume(middle[3])
    assert "enumerated" not in races.events
    searching = [state for event, state in races.places if event == "searching"]
    assert min(batches(state) for state in searching) == 3
    assert trials.log.iterations > 3
    assert middle[3].seconds < searching[0].seconds


def test_a_table_that_nobody_has_judged_is_found_again(first, races):
    outcome, places = first
    event, place = places[-1]
    assert event == "probing"
    assert TRIALS not in place.exhausted
    trials = races.resume(place)
    best = max(candidate.mean for candidate in trials.take_candidates())
    assert best >= outcome.chosen.mean


def test_a_race_stopped_while_its_states_are_enumerated_does_that_again(first, races, monkeypatch):
    # its episodes ask the clock, too
    monkeypatch.setattr("mdpo_rddl.auto.race.race.watched", lambda problem, has_time: problem)
    _, place = first[1][0]
    assert place.marks["over"] == []
    races.resume(place)
    assert races.events.count("enumerated") == 1
    # what was done since counts only once
    seconds = [state.seconds for _, state in races.places]
    assert place.seconds < seconds[0] < place.seconds + 15.0
