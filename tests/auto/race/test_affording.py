"""Which programs there is time for."""

from types import SimpleNamespace

import pytest

from mdpo_rddl.auto.race import affording as module
from mdpo_rddl.auto.race.affording import Affording
from mdpo_rddl.planner.programs.quick import light_jit, quick_jit


@pytest.fixture(autouse=True)
def _quick_programs_take_six_tenths(monkeypatch):
    """As on a CPU with the releases of XLA that have such options."""
    monkeypatch.setattr(module, "quick_share", lambda: 0.6)


def affording(
    rollout_seconds: float, left: float = 40.0, usual: float = 2.0, large=None, probed=None
):
    return Affording(
        SimpleNamespace(
            clock=lambda: 20.0,
            deadline=20.0 + left,
            probed=probed,
            probe=SimpleNamespace(policy_seconds=large),
            judge=SimpleNamespace(
                usual_seconds=usual, rollout_seconds=rollout_seconds, rollouts=128
            ),
        )
    )


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        # 8 s for the program and 30 iterations of 0.23 s are 14.9 of 16 s
        ({"rollout_seconds": 0.05}, True),
        ({"rollout_seconds": 0.06}, False),
        ({"rollout_seconds": 0.06, "left": 60.0}, True),
        # 8.4 s for a program four times the judge's, and 7.5 s; 8.8 and 7.5 are too much
        ({"rollout_seconds": 0.055, "usual": 2.1}, True),
        ({"rollout_seconds": 0.055, "usual": 2.2}, False),
        # 15 s, and 1 s; 0.6 of 18 s, of the quick kind, and 1 s; of 18.4 s
        ({"rollout_seconds": 0.001, "usual": 6.0, "left": 46.0}, True),
        ({"rollout_seconds": 0.001, "usual": 8.0, "left": 46.0}, True),
        # a program of the quick kind, 4.8 s
        ({"rollout_seconds": 0.001, "left": 16.0}, True),
        ({"rollout_seconds": 0.001, "left": 14.0}, False),
        ({"rollout_seconds": 0.001, "large": 1.0}, False),
    ],
)
def test_a_value_is_learnt_where_there_is_time_for_enough_iterations(case, expected):
    assert affording(**case).value(0.4) == expected


@pytest.mark.parametrize(("in_turn", "expected"), [(1, True), (8, True), (9, False)])
def test_changes_that_are_tried_in_turn_take_longer(in_turn, expected):
    # 8 s for the program and 30 iterations of 0.25 s are of 16 s, of 0.28 s are more
    assert affording(0.0166).value(0.4, in_turn) == expected


@pytest.mark.parametrize(
    ("case", "has_time", "expected"),
    [
        # 20 s for the program of a population
        ({"rollout_seconds": 0.5, "usual": 10.0}, True, True),
        # 60 s; 8 policies one by one, or by the probing's program; and 300
        ({"rollout_seconds": 4.9, "usual": 40.0}, None, True),
        ({"rollout_seconds": 5.1, "usual": 40.0}, None, False),
        ({"rollout_seconds": 4.9, "usual": 40.0}, False, True),
        ({"rollout_seconds": 4.9, "usual": 40.0}, True, False),
        ({"rollout_seconds": 0.14, "usual": 40.0}, True, False),
        ({"rollout_seconds": 0.13, "usual": 40.0}, True, True),
    ],
)
def test_few_policies_one_by_one_are_worse_than_rules_side_by_side(case, has_time, expected):
    probed = None
    if has_time is not None:
        probed = SimpleNamespace(has_time=lambda until, clock: has_time and until == 60.0)
    assert affording(**case, probed=probed).policies() is expected


def test_what_would_begin_later_has_less_time():
    # 8 s for the program and 30 iterations of 0.034 s are 9 s, of 0.4 times what is left then
    assert affording(0.001).value(0.4, later=17.0)
    assert not affording(0.001).value(0.4, later=18.0)


@pytest.mark.parametrize(
    ("usual", "left", "seconds", "jit"),
    [
        # 8 and 15 s otherwise
        (2.0, 25.0, 8.0, light_jit),
        (2.0, 23.0, 4.8, quick_jit),
        (6.0, 46.0, 15.0, light_jit),
        (6.0, 44.0, 9.0, quick_jit),
    ],
)
def test_the_program_of_what_learns_a_value_is_quick_where_little_time_is_left(
    usual, left, seconds, jit
):
    asked = affording(0.001, left, usual)
    assert asked.usual_seconds("greedy") == pytest.approx(seconds)
    assert asked.value_jit() is jit


@pytest.mark.parametrize(
    ("is_compiled", "deterministic", "observations", "left", "expected"),
    [
        (False, False, (), 20.5, True),
        (False, False, (), 19.5, False),
        (False, True, (), 10.5, True),
        (False, True, (), 9.5, False),
        (False, False, ("seen",), 10.5, True),
        (False, False, ("seen",), 9.5, False),
        (True, False, (), 9.5, True),
    ],
)
def test_plans_are_tried_where_their_program_takes_little_of_the_time(
    is_compiled, deterministic, observations, left, expected
):
    # 3 s for it
    asked = affording(0.01, left)
    asked._arena.plans = SimpleNamespace(is_compiled=is_compiled, deterministic=deterministic)
    rddl = SimpleNamespace(observ_fluents=dict.fromkeys(observations))
    asked._arena.planner = SimpleNamespace(rddl=rddl)
    assert asked.plans() == expected
    asked._arena.has_plan = True
    assert asked.plans_seconds() == (3.0 if expected and not is_compiled else 0.0)
    asked._arena.has_plan = False
    assert asked.plans_seconds() == 0.0


@pytest.mark.parametrize(
    ("left", "expected"),
    [
        # 13.8 s for its program, 0.4 s for rollouts: half the time is enough for any
        (29.0, (True, True)),
        # four fifths for one that comes first
        (18.0, (False, True)),
        (17.0, (False, False)),
    ],
)
def test_what_comes_first_may_need_most_of_the_time(left, expected):
    asked = affording(0.02, left, usual=6.0)
    until = 20.0 + left
    assert (asked.gradient("shooting", until), asked.gradient("shooting", until, True)) == expected


@pytest.mark.parametrize(("left", "expected"), [(16.0, True), (10.0, False)])
def test_plans_side_by_side_come_before_the_population(left, expected):
    # 2.3 times what the judge's program took, and 0.4 s; there is no population yet
    asked = affording(0.02, left, usual=4.0)
    assert asked.usual_seconds("shooting") == pytest.approx(9.2)
    assert asked.gradient("shooting", 20.0 + left, comes_first=True) is expected


@pytest.mark.parametrize(("share", "expected"), [(1.0, True), (0.1, True), (0.05, False)])
def test_a_population_takes_a_share_of_the_time(share, expected):
    # 3 s of 40
    assert affording(0.01).population(share) is expected


@pytest.mark.parametrize(
    ("seconds", "left", "expected"),
    [
        # 10.9 times 4 s and 1 s of rollouts, of seven tenths; six tenths of that in a short race
        (60.0, 39.0, True),
        (60.0, 38.0, False),
        (600.0, 64.0, True),
        (600.0, 63.0, False),
    ],
)
def test_a_gradient_is_compiled_more_quickly_in_a_short_race(seconds, left, expected):
    asked = affording(0.01, left, usual=4.0)
    asked._arena.population = SimpleNamespace(seconds=0.01)
    asked._arena.seconds = seconds
    assert asked.gradient("gradient", 20.0 + left) == expected


def test_a_program_that_leaves_few_seconds_comes_no_earlier():
    # 9.2 s for its program and 0.4 s of rollouts: less than four fifths
    asked = affording(0.02, 14.0, usual=4.0)
    assert not asked.gradient("shooting", 34.0, comes_first=True)
