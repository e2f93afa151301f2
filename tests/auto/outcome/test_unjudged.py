"""A race whose time is over before anything could be judged."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.clocks import Stopped
from helpers.lakes import preset

from mdpo_rddl.auto import RaceOptions, plan_automatically
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.common.compilations import TooLateError
from mdpo_rddl.auto.outcome.unjudged import known_kept
from mdpo_rddl.auto.outcome.unsearched import known_by_probing
from mdpo_rddl.auto.probing import constants
from mdpo_rddl.auto.race import race
from mdpo_rddl.auto.resuming.earlier import EarlierPolicy, EarlierRace
from mdpo_rddl.machine.background import Background
from mdpo_rddl.problem.load import make_environment

SECONDS, LONG = 0.5, 60.0
CAUSE = "the time was over before the first program was compiled"


@pytest.fixture
def clock():
    return Stopped()


@pytest.fixture
def endless_compilation(monkeypatch, clock):
    """The first program is not there before the test is over."""
    released, ended = threading.Event(), threading.Event()

    def slow(planner, rollouts, side_by_side, jit):
        clock.now += SECONDS
        released.wait(LONG)
        ended.set()
        raise ValueError("nobody waits for it")

    monkeypatch.setattr(constants, "compile_visits", slow)
    yield ended
    released.set()
    assert ended.wait(LONG)


def test_the_noop_is_the_result_if_nothing_is_compiled_in_time(
    lake, endless_compilation, clock, caplog
):
    outcome = plan_automatically(lake, preset(SECONDS), 0, RaceOptions(clock=clock))
    assert not endless_compilation.is_set()
    assert (outcome.seconds, outcome.compile_seconds) == (SECONDS, SECONDS)
    assert (outcome.chosen.label, outcome.judged, outcome.was_played) == ("no-op", [], False)
    assert not outcome.interrupted
    state, _ = make_environment(lake).reset(seed=0)
    assert outcome.policy(0, state)["pump"] == 0.0
    figures = outcome.diagnostics()
    assert figures["arms"]["constants and rules"]["cause"] == CAUSE
    assert figures["arms"]["constants and rules"]["best_return"] is None
    assert (figures["candidates"], figures["noop_return"]) == ([], None)
    assert caplog.messages == [f"{CAUSE}: the result is 'no-op', which nobody has judged"]


def test_what_an_earlier_race_has_left_is_the_result_if_nothing_is_compiled_in_time(
    lake, endless_compilation, clock
):
    earlier = earlier_race(-30.0)
    options = RaceOptions(clock=clock, earlier=earlier)
    outcome = plan_automatically(lake, preset(earlier.seconds + SECONDS), 0, options)
    assert not endless_compilation.is_set()
    assert (outcome.chosen.label, outcome.chosen.mean) == ("a plan", -30.0)
    assert not outcome.interrupted


@pytest.mark.parametrize(
    ("seconds", "latest", "deadline"),
    [
        (1500.0, 10_000.0, 9800.0),  # the judge's program would not be there in time
        (1500.0, -np.inf, 1470.0),
        (2500.0, 10_000.0, 2450.0),
    ],
)
def test_a_race_whose_judge_would_come_too_late_may_have_more(
    lake, clock, monkeypatch, seconds, latest, deadline
):
    compile_visits = constants.compile_visits

    def slow(*given, **named):
        clock.now += 1000.0
        return compile_visits(*given, **named)

    monkeypatch.setattr(constants, "compile_visits", slow)
    options = RaceOptions(clock=clock, at_the_latest=latest)
    arena = race._arena(lake, preset(seconds), 0, 0.0, options)
    assert (arena.deadline, arena.judge._deadline) == (deadline, deadline)
    assert arena.config.budget().seconds == (latest if deadline == 9800.0 else seconds)


def test_a_race_that_goes_on_after_its_own_time_has_no_more(lake, clock):
    options = RaceOptions(clock=clock, at_the_latest=10_000.0)
    assert race._arena(lake, preset(1500.0), 0, -9000.0, options).deadline == -7530.0


def test_an_interrupt_does_not_wait_for_the_first_program(
    lake, endless_compilation, clock, monkeypatch
):
    def interrupted(work, until):
        raise KeyboardInterrupt

    monkeypatch.setattr(Background, "wait", interrupted)
    with pytest.raises(KeyboardInterrupt):
        plan_automatically(lake, preset(LONG), 0, RaceOptions(clock=clock))
    assert not endless_compilation.is_set()


def earlier_race(mean: float) -> EarlierRace:
    params = {"plan": {"pump": np.full(8, 37.0)}}
    policy = EarlierPolicy(preset(1.0), params, {}, "plan", "a plan", (), False, mean, 3.0)
    return EarlierRace(1.0, policy)


@pytest.fixture
def arena():
    seen = {"noop_return": -5.0, "start_return": -2.0, "policy_seconds": None}
    probe = SimpleNamespace(**seen, deterministic=False)

    def candidate(arm, label, params):
        return Candidate(arm, label, preset(1.0), None, params)

    judge = Judge(1, 0, Stopped(), 0.0)
    names = {"noop": "noop", "constant": "constant", "problem": None, "seed": 0, "probed": None}
    return SimpleNamespace(probe=probe, judge=judge, candidate=candidate, **names)


@pytest.mark.usefixtures("failing_race")
@pytest.mark.parametrize(
    ("start", "table", "expected"),
    [
        (-2.0, None, "constant"),
        (-9.0, None, "no-op"),
        (-2.0, 1.0, "table"),
        (-2.0, -4.0, "constant"),
    ],
)
def test_what_was_seen_before_the_judge_counts(arena, start, table, expected):
    arena.probe.start_return = start
    found = [Candidate("trials", "table", preset(1.0), None, None, mean=table, error=0.0)]
    told = []
    early = SimpleNamespace(take_candidates=lambda: found, judged=told.append)
    with known_kept(arena, None, [] if table is None else [early]):
        raise TooLateError("too late")
    assert arena.judge.incumbent.label == expected
    assert [each.mean for each in told] == ([] if table is None else [table])


def test_without_chance_all_of_the_judge_s_returns_are_known(arena):
    assert [candidate.returns for candidate in known_by_probing(arena)] == [None, None]
    arena.probe.deterministic = True
    assert [candidate.returns.tolist() for candidate in known_by_probing(arena)] == [[-5.0], [-2.0]]
    arena.probe.policy_seconds = 1.0
    assert [candidate.returns for candidate in known_by_probing(arena)] == [None, None]


@pytest.mark.usefixtures("failing_race")
@pytest.mark.parametrize("is_late", [False, True])
def test_a_table_that_was_found_meanwhile_counts_in_a_race_that_goes_on(arena, is_late):
    table = Candidate("trials", "table", preset(1.0), None, None, mean=-20.0, error=0.0)
    early = SimpleNamespace(take_candidates=lambda: [table], judged=lambda candidate: None)
    with known_kept(arena, earlier_race(-30.0), [early]):
        if is_late:
            raise TooLateError("too late")
    assert arena.judge.incumbent.label == "table"


@pytest.mark.usefixtures("failing_race")
def test_a_race_that_goes_on_keeps_what_it_had(arena, caplog):
    with known_kept(arena, earlier_race(-30.0), []):
        raise TooLateError("too late")
    incumbent = arena.judge.incumbent
    assert (incumbent.label, incumbent.mean, incumbent.error) == ("a plan", -30.0, 3.0)
    assert caplog.messages == ["the best policy so far is kept: too late"]
