"""Arms that begin with what probing has found, before anything else is compiled."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.lakes import preset, write_lake
from helpers.races import CLOCK

from mdpo_rddl.auto import RaceOptions
from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.arms.policy_iteration import GREEDY
from mdpo_rddl.auto.arms.shooting import SHOOTING
from mdpo_rddl.auto.arms.simple import SimpleArm
from mdpo_rddl.auto.race import affording, race
from mdpo_rddl.auto.race.openings import Openings
from mdpo_rddl.auto.race.schedule import Schedule

SECONDS = 600.0


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    lake = write_lake(tmp_path_factory.mktemp("lake"))
    return race._arena(lake, preset(SECONDS), 0, CLOCK(), RaceOptions(clock=CLOCK))


@pytest.fixture
def openings(compiled):
    judge = Judge(128, 0, CLOCK, compiled.began)
    arena = replace(compiled, judge=judge)
    found = Openings(arena, race._shares(preset(SECONDS)), lambda stage: None)
    found._entrants = SimpleNamespace(
        may_be_greedy=lambda share: False,
        may_shoot=lambda until: True,
        greedy=lambda until, share: None,
        has_numbers=False,
        straight_line=lambda until: None,
    )
    return found


def test_what_probing_has_found_is_enough_to_begin(openings, monkeypatch):
    monkeypatch.setattr(Judge, "returns_of", lambda self, candidate: pytest.fail("it is compiled"))
    probe = openings._arena.probe
    assert openings._knows_by_probing()
    found = {judged.candidate.label: judged.candidate.mean for judged in openings._judge.judged}
    assert found == {"no-op": probe.noop_return, "constant": probe.start_return}
    assert openings._best.label == "constant"
    # only a race that begins needs that
    assert not openings._knows_by_probing()


def test_what_the_judge_says_replaces_what_probing_has_said(openings, monkeypatch):
    assert openings._knows_by_probing()
    lucky, judge = openings._best, openings._judge
    less = (lucky.mean - openings._arena.probe.noop_return) / 4.0
    returns = lucky.mean - np.array([less, 2.0 * less])

    def give(arm, until):
        own = openings._arena.candidate(arm.name, lucky.label, lucky.params)
        judge.record(replace(own, mean=returns.mean(), error=0.5 * less, returns=returns))

    monkeypatch.setattr(openings, "give", give)
    openings._judge_simple(SimpleArm(openings._arena))
    assert lucky.error == 0.0
    assert lucky.returns is None
    assert openings._best.label == lucky.label
    assert judge.best_mean == pytest.approx(lucky.mean - 1.5 * less)


class Plans(Arm):
    """Relaxed plans that say how they do, and note the slices that they have."""

    def __init__(self, leading, is_untried=False, misses_numbers=False):
        super().__init__("relaxed plans", CLOCK)
        self.leading, self.is_untried, self.ends = leading, is_untried, []
        self.misses_numbers = misses_numbers

    def _work(self, until):
        self.ends.append(until)


@pytest.mark.parametrize(
    ("leading", "is_untried", "share"),
    # a constant returns more than the no-op here, so that they are not the only hope
    [(1e9, False, 0.2), (-1e9, False, 0.0), (-1e9, True, 0.2)],
)
def test_relaxed_plans_that_may_lead_have_another_slice(openings, leading, is_untried, share):
    arena = openings._arena
    assert openings._knows_by_probing()
    openings.plans = arm = Plans(leading, is_untried)
    until = arena.until(share)
    openings._judge_plans()
    assert arm.ends == ([pytest.approx(until, abs=1.0)] if share else [])
    assert arm in openings.arms


@pytest.mark.parametrize("has_plan", [False, True])
def test_relaxed_plans_have_more_time_where_nothing_else_finds_a_reward(
    openings, monkeypatch, has_plan
):
    assert openings._knows_by_probing()
    # with a plan or without
    monkeypatch.setattr(type(openings._arena), "has_plan", has_plan)
    monkeypatch.setattr(type(openings._arena), "beats_noop", lambda self, candidate: False)
    openings.plans = arm = Plans(1e9)
    until = openings._arena.until(0.6)
    openings._judge_plans()
    assert arm.ends == [pytest.approx(until, abs=1.0)]


def test_elsewhere_the_judge_comes_first(openings):
    arena = openings._arena
    openings._entrants.may_shoot = lambda until: False
    assert not openings._knows_by_probing()
    openings._entrants.may_shoot = lambda until: True
    rare = replace(arena.probe, start_return=arena.probe.noop_return)
    openings._arena = replace(arena, probe=rare)
    assert not openings._knows_by_probing()
    assert not openings._judge.judged


@pytest.mark.parametrize(
    ("seconds", "needed", "is_late"),
    # of 600 s, of which twice the delay must leave enough
    [(100.0, 300.0, False), (160.0, 300.0, True), (160.0, 700.0, False)],
)
def test_greedy_may_come_too_late_after_another(openings, seconds, needed, is_late):
    arena = openings._arena
    left = arena.deadline - arena.clock()
    openings._entrants.may_be_greedy = lambda share, later=0.0: left - later >= needed
    assert openings._makes_greedy_late(arena.clock() + seconds) == is_late


@pytest.mark.parametrize(
    ("leader", "has_stalled", "needed", "expected"),
    [
        # what the programs of all others need, as a share of the time left
        (GREEDY, False, 0.2, False),
        (GREEDY, False, 0.4, True),
        (SHOOTING, False, 0.2, True),
        (SHOOTING, False, 0.1, False),
        # its plan gains no more: they may need more
        (SHOOTING, True, 0.4, False),
        (SHOOTING, True, 0.6, True),
        ("constants and rules", False, 0.9, False),
    ],
)
def test_who_leads_goes_on_alone_where_others_would_come_too_late(
    openings, leader, has_stalled, needed, expected
):
    assert openings._knows_by_probing()
    openings._affording = SimpleNamespace(others=lambda share: needed <= share)
    openings._has_stalled = has_stalled
    openings._judge.incumbent = replace(openings._best, arm=leader)
    assert openings._open_alone() is expected


@pytest.mark.parametrize(("needed", "expected"), [(0.5, False), (0.7, True)])
def test_among_numbers_others_may_take_more_of_what_greedy_would_have(openings, needed, expected):
    assert openings._knows_by_probing()
    openings._affording = SimpleNamespace(others=lambda share: needed <= share)
    openings._entrants.has_numbers = True
    openings._judge.incumbent = replace(openings._best, arm=GREEDY)
    assert openings._open_alone() is expected


@pytest.mark.parametrize(
    # shares of the time left, of which the searches in turn take 0.32; actions may all be bools
    ("share", "decides_numbers", "is_opened"),
    [(0.6, True, False), (0.8, True, True), (0.8, False, False), (1.1, True, False)],
)
@pytest.mark.parametrize("cores", [1, 2])
def test_the_gradient_begins_earlier_where_it_would_come_too_late(
    openings, monkeypatch, share, decides_numbers, is_opened, cores
):
    monkeypatch.setattr(affording, "usable_cores", lambda: cores)
    arena = openings._arena
    started, opened = arena.clock(), []
    left = arena.deadline - started
    needed = share * left

    def gradient(until, arms, warns):
        assert not warns
        return SimpleNamespace(usual_seconds=20.0) if left >= needed else None

    openings._affording.gradient = lambda name, until, later: left - later >= needed
    openings._entrants.gradient = gradient
    openings._entrants.decides_numbers = decides_numbers
    openings._open = lambda arm, until, patience: opened.append(patience - started)
    openings._open_gradient(arena.deadline)
    # it is waited for twice as long as it should take, while the clock ticks; others can work
    # meanwhile where there are two cores
    patience = 40.0 if cores == 1 else 0.0
    assert opened == ([pytest.approx(patience, abs=10.0)] if is_opened else [])


def test_the_searches_in_turn_keep_some_time_beside_an_early_gradient(openings, monkeypatch):
    monkeypatch.setattr(affording, "usable_cores", lambda: 1)
    now = openings._arena.clock()
    found = openings._affording.early_patience(60.0, now + 100.0)
    assert found == pytest.approx(now + 80.0, abs=3.0)


class Greedy(Arm):
    """An arm of this name that does nothing."""

    def __init__(self, is_exhausted=False):
        super().__init__(GREEDY, CLOCK)
        self.is_exhausted = is_exhausted

    def _work(self, until):
        raise AssertionError("it has a slice")


def found_by_greedy(openings, times, error=0.0):
    """Greedy has gained so many times what the best constant gains over the no-op."""
    assert openings._knows_by_probing()
    openings._entrants.has_numbers = True
    openings._affording = SimpleNamespace(others=lambda share: True)
    openings.arms.append(Greedy())
    noop, constant = openings._arena.noop_return.mean, openings._best
    gain = constant.mean - noop
    mean = noop + times * gain
    openings._judge.record(replace(constant, arm=GREEDY, mean=mean, error=error * gain))
    assert openings._best.arm == GREEDY


@pytest.mark.parametrize(
    ("times", "error", "expected"), [(2.1, 0.0, True), (1.9, 0.0, False), (2.1, 0.7, False)]
)
def test_greedy_that_leads_by_far_among_numbers_has_all_the_time(openings, times, error, expected):
    found_by_greedy(openings, times, error)
    assert openings._open_alone() is expected


def test_where_all_are_bools_it_has_most_of_the_time_in_any_case(openings):
    found_by_greedy(openings, 3.0)
    openings._entrants.has_numbers = False
    assert not openings._open_alone()


def test_an_exhausted_greedy_leaves_the_time_to_others(openings):
    found_by_greedy(openings, 3.0)
    openings.arms[-1].is_exhausted = True
    assert not openings._open_alone()


def test_others_must_have_found_something_for_greedy_to_be_far_ahead(openings, monkeypatch):
    found_by_greedy(openings, 3.0)
    arena = type(openings._arena)
    monkeypatch.setattr(arena, "beats_noop", lambda self, candidate: candidate.arm == GREEDY)
    assert not openings._open_alone()


def test_nobody_is_far_ahead_of_nobody(openings):
    found_by_greedy(openings, 3.0)
    openings._judge.judged = openings._judge.judged[-1:]
    assert not openings._open_alone()


def test_no_population_is_compiled_where_greedy_leads_by_far(compiled, monkeypatch):
    arena = replace(compiled, judge=Judge(128, 0, CLOCK, compiled.began))
    schedule = Schedule(arena, race._shares(preset(SECONDS)), lambda stage: None)
    called = []
    monkeypatch.setattr(schedule, "_learn_first", lambda: True)
    monkeypatch.setattr(schedule, "_finish", lambda: called.append("finish"))
    monkeypatch.setattr(schedule, "_climb_first", lambda: called.append("climb"))
    schedule._search(SimpleArm(arena))
    assert called == ["finish"]


def test_what_the_program_of_plans_takes_leaves_the_gradient_less_time(openings, monkeypatch):
    monkeypatch.setattr(affording, "usable_cores", lambda: 1)
    opened, left = [], openings._arena.deadline - openings._arena.clock()
    # what is left after the searches would do, but for that program
    openings._affording.gradient = lambda name, until, later: left - later >= 0.6 * left
    openings._affording.plans_seconds = lambda: 0.1 * left
    openings._entrants.gradient = lambda *arguments, **options: SimpleNamespace(usual_seconds=1)
    openings._entrants.decides_numbers = True
    openings._open = lambda arm, until, patience: opened.append(arm)
    openings._open_gradient(openings._arena.deadline)
    assert len(opened) == 1


@pytest.mark.parametrize(("leading", "slices"), [(-1e9, 0), (1e9, 1)])
def test_relaxed_plans_that_miss_what_actions_do_are_no_hope(openings, leading, slices):
    assert openings._knows_by_probing()
    openings.plans = arm = Plans(leading, is_untried=True, misses_numbers=True)
    openings._judge_plans()
    assert len(arm.ends) == slices
