"""An arm that worked before the race: when it goes on before the others."""

from types import SimpleNamespace

import pytest
from helpers.clocks import Stopped
from helpers.lakes import preset

from mdpo_rddl.auto.arena.judge import Judge
from mdpo_rddl.auto.arms.base import Arm
from mdpo_rddl.auto.common.candidate import Candidate
from mdpo_rddl.auto.race.schedule import Schedule
from mdpo_rddl.auto.race.slices import Terms
from mdpo_rddl.planner.config.search_section import Search


class Scripted(Arm):
    """Offers a candidate of the next return in each slice, which it works to the end of."""

    def __init__(self, clock, returns):
        super().__init__("scripted", clock)
        self.left = list(returns)

    def _work(self, until):
        self._clock.now = until
        if self.left:
            mean = self.left.pop(0)
            self._offer(
                Candidate(self.name, "table", preset(1.0), None, None, mean=mean, error=0.0)
            )


def times(deadline=160.0):
    """Of an arena that begins at 0."""
    return {"began": 0.0, "deadline": deadline, "seconds": deadline}


def slices(returns, deadline=160.0, is_rare=False):
    """How many slices the arm has had before the others begin, and the best return."""
    clock = Stopped()
    judge = Judge(1, 0, clock, 0.0)
    judge.record(Candidate("other", "no-op", preset(1.0), None, None, mean=0.0, error=0.0))
    given = times(deadline)
    arena = SimpleNamespace(judge=judge, clock=clock, **given, has_plan=is_rare, incumbent=None)
    arena.beats_noop = lambda candidate: False
    arm = Scripted(clock, returns)
    arm.work(1.0)
    schedule = Schedule(arena, Search(), lambda name: None)
    schedule._try_early(arm, 100.0)
    assert schedule.arms == [arm]
    return arm.log.slices, judge.best_mean


@pytest.mark.parametrize(
    ("returns", "expected"),
    [
        ([-1.0, 5.0], (1, 0.0)),  # it has found nothing before
        ([1.0, 2.0, 3.0, 3.0, 9.0], (4, 3.0)),  # as long as it gains
        ([1.0], (2, 1.0)),
    ],
)
def test_it_goes_on_as_long_as_it_gains(returns, expected):
    assert slices(returns) == expected


def test_where_no_other_finds_a_reward_its_own_figures_decide(monkeypatch):
    # it knows more after each slice, whatever it returns in a few episodes
    monkeypatch.setattr(Scripted, "progress", property(lambda arm: min(5, arm.log.slices)))
    assert slices([1.0, 1.0, 1.0], is_rare=True) == (6, 1.0)
    assert slices([1.0, 1.0, 1.0]) == (2, 1.0)


def test_it_ends_in_time():
    count, best = slices(range(1, 100))
    # no shorter ones, but slices of 10 seconds until 100
    assert count == best == 1 + 10


class Planned(Scripted):
    """One that must compile, and does so at once or never."""

    descends = False

    def __init__(self, clock, returns, is_pending=False):
        super().__init__(clock, returns)
        self._pending, self.gives_up = is_pending, False

    def _work(self, until):
        super()._work(until)
        self.is_exhausted = self.gives_up

    @property
    def is_pending(self):
        return self._pending

    def begin(self, until):
        """Compiles nothing."""


@pytest.mark.parametrize(
    ("returns", "is_pending", "expected"),
    [
        # the first gains 100, the fourth less than 2 more
        ([-2.0, 0.5, 3.0, 4.9, 9.0], False, 4),
        ([-2.0, 0.5, 3.0, 4.9, 9.0], True, 0),
        # slices of 5, 5, and then 10 seconds until 96, six tenths of 160
        (range(5, 1000, 5), False, 2 + 9),
    ],
)
def test_a_plan_that_comes_first_goes_on_as_long_as_it_gains(returns, is_pending, expected):
    arm, schedule, _ = first(returns, is_pending, least_gain=lambda: 0.02)
    assert schedule.arms == [arm]
    assert arm.log.slices == expected
    # it competes with the others later
    assert [contender.arm for contender in schedule._contenders] == [arm]


@pytest.mark.parametrize(("at_least", "slices", "until"), [(0.0, 2, 10.0), (0.25, 3, 45.0)])
def test_one_that_learns_slowly_at_first_has_a_slice_in_any_case(at_least, slices, until):
    arm, _, clock = first([-20.0] * 9, at_least=lambda: at_least)
    assert arm.log.slices == slices
    assert clock.now == until


@pytest.mark.parametrize(("by_policies", "slices"), [(True, 2), (False, 11)])
def test_one_that_finds_no_reward_is_left_though_its_rollouts_return_more(
    by_policies, slices, monkeypatch
):
    progress = property(lambda self: 30.0 * self.log.slices)
    monkeypatch.setattr(Planned, "progress", progress)
    arm, _, _ = first([-40.0] * 99, by_policies=lambda: by_policies)
    assert arm.log.slices == slices


@pytest.mark.parametrize(("pace", "slices"), [(6.0, 11), (1.0, 2)])
def test_one_that_is_behind_must_catch_up_in_time(pace, slices, monkeypatch):
    progress = property(lambda self: -60.0 + pace * self.log.slices)
    monkeypatch.setattr(Planned, "progress", progress)
    arm, _, _ = first([-40.0] * 99)
    assert arm.log.slices == slices


def test_one_that_has_given_up_has_no_slice():
    assert first([1.0, 2.0], at_least=lambda: 0.25, gives_up=True)[0].log.slices == 1


@pytest.mark.parametrize(
    ("tells", "share", "at_least"),
    [
        (set(), 0.85, 0.4),
        ({"rare"}, 0.6, 0.0),
        # what its first slice has found is a reward
        ({"rare", "found"}, 0.6, 0.4),
        ({"numbers"}, 0.6, 0.2),
    ],
)
def test_a_value_that_finds_no_reward_or_is_of_numbers_has_less_time(tells, share, at_least):
    clock, judge = Stopped(), Judge(1, 0, Stopped(), 0.0)
    judge.record(Candidate("other", "no-op", preset(1.0), None, None, mean=-9.0, error=0.0))
    arena = raced_arena(judge, clock)
    arena.has_plan, arena.incumbent = True, None
    better = set() if "rare" in tells else {None}
    better |= {"greedy"} if "found" in tells else set()
    arena.beats_noop = lambda candidate: (candidate and candidate.arm) in better
    schedule = Schedule(arena, Search(), lambda name: None)
    asked = []

    def greedy(until, share):
        asked.append((until, share))
        # there is no time for it at first
        return named("greedy", Planned(clock, [1.0])) if len(asked) > 1 else None

    schedule._entrants = SimpleNamespace(greedy=greedy, has_numbers="numbers" in tells)
    schedule._learn_first()
    assert not schedule.arms
    schedule._learn_first()
    assert [arm.name for arm in schedule.arms] == ["greedy"]
    assert asked == [(160.0 * share, share)] * 2
    # how long it goes on although it gains nothing; its slices are a few seconds long
    assert at_least <= schedule.arms[0].log.seconds / 160.0 < at_least + 0.19


def named(name, arm):
    """The arm under another name."""
    arm.name = name
    return arm


def raced_arena(judge, clock):
    """What a schedule asks for, with 160 s."""
    return SimpleNamespace(
        judge=judge,
        clock=clock,
        probe=SimpleNamespace(noop_return=-102.0),
        **times(),
        until=lambda share: 160.0 * share,
    )


def first(returns, is_pending=False, gives_up=False, kind=Planned, **given):
    """An arm that came first, its schedule and the clock after that."""
    clock = Stopped()
    judge = Judge(1, 0, clock, 0.0)
    judge.record(Candidate("other", "no-op", preset(1.0), None, None, mean=-9.0, error=0.0))
    schedule = Schedule(raced_arena(judge, clock), Search(), lambda name: None)
    arm = kind(clock, returns, is_pending)
    arm.gives_up = gives_up
    schedule._begin_with(arm, Terms(96.0, **given))
    return arm, schedule, clock


@pytest.mark.parametrize(
    ("polishing_ends", "name", "slices"),
    [(True, "gradient", 1), (True, "own weights", 0), (False, "gradient", 0)],
)
def test_a_gradient_goes_on_where_its_policy_cannot_be_polished(polishing_ends, name, slices):
    clock = Stopped()
    clock.now = 150.0
    judge, planner = Judge(1, 0, clock, 0.0), object()
    judge.record(Candidate(name, "best", preset(1.0), planner, None, mean=0.0, error=0.0))
    arena = SimpleNamespace(judge=judge, clock=clock, planner=planner, **times(), incumbent=None)
    schedule = Schedule(arena, Search(), lambda name: None)
    leader, polisher = Scripted(clock, []), Scripted(clock, [])
    leader.name, polisher.is_exhausted = name, polishing_ends
    schedule.arms.append(leader)
    schedule._polishers[False] = polisher
    schedule._finish()
    assert leader.log.slices == slices
    assert polisher.log.slices == int(not polishing_ends)
