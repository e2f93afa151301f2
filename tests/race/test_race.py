"""The race as a whole: turns, the board, episodes in common, and the end."""

import itertools
from typing import Any, NamedTuple

import numpy as np
import pytest
from helpers.lakes import write_lake

from mdpo_rddl.errors import Cancelled
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.problem.evaluation import LOST, lost_worth
from mdpo_rddl.problem.load import load_problem
from mdpo_rddl.race.arm import Arm, Candidate
from mdpo_rddl.race.arms import weights
from mdpo_rddl.race.budget import Budget, DeadlineError
from mdpo_rddl.race.evaluator import CONFIRMATION, FEWEST, Evaluator, worth
from mdpo_rddl.race.probe import probe
from mdpo_rddl.race.race import CONSTANT, NOOP, RaceOptions, race
from mdpo_rddl.race.weights import Weights
from mdpo_rddl.simulator.common import CommonNumbers
from mdpo_rddl.simulator.simulator import Simulator

# moves to the left make the environment raise an error
ONE_SIDED = """
domain one_sided {
    pvariables {
        x : { state-fluent, real, default = 0.0 };
        move : { action-fluent, real, default = 0.0 };
    };
    cpfs { x' = x + move + Normal(0.0, 0.01 * move); };
    reward = -abs[x - 3.0];
}
"""
INSTANCE = """
non-fluents nf { domain = one_sided; }
instance one {
    domain = one_sided; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 5; discount = 1.0;
}
"""


class Clock:
    """Tells one second more each time it is asked."""

    def __init__(self) -> None:
        self.ticks = itertools.count()

    def __call__(self) -> float:
        return float(next(self.ticks))


class Counting(NamedTuple):
    """The state of an arm that only counts its steps."""

    found: tuple[Candidate, ...] = ()
    claim: float = -np.inf
    iterations: int = 0
    is_ready: bool = True
    is_exhausted: bool = False
    details: Any = None


def counting(name: str, claims: Any, ready_after: int = 0) -> Arm:
    """Claims what it is told to, step by step; is ready after so many polls."""

    def step(context, state, turn):
        number = state.iterations + 1
        return state._replace(
            iterations=number, claim=claims(number), is_ready=number >= ready_after
        )

    return Arm(name, lambda context: Counting(is_ready=not ready_after), step)


@pytest.fixture(scope="module")
def lake(tmp_path_factory):
    return write_lake(tmp_path_factory.mktemp("lake"))


@pytest.fixture(scope="module")
def one_sided(tmp_path_factory):
    folder = tmp_path_factory.mktemp("one_sided")
    for name, text in (("d.rddl", ONE_SIDED), ("i.rddl", INSTANCE)):
        (folder / name).write_text(text)
    return load_problem(str(folder / "d.rddl"), str(folder / "i.rddl"))


def played(problem, seconds=400.0, **options):
    """A race by a clock that ticks when it is asked."""
    budget = Budget.of(seconds, Clock())
    return race(problem, auto_preset(""), budget, 0, RaceOptions(**options))


def constant(value):
    return lambda step, observation: {"move": np.full(1, value)}


def none():
    """No check."""


# --- budget ------------------------------------------------------------------------------------


def test_a_budget_is_spent_at_its_deadline():
    budget = Budget(2.0, 12.0, lambda: 7.0)
    assert (budget.seconds, budget.used, budget.left) == (10.0, 5.0, 5.0)
    half = budget.share(0.5)
    assert (half.began, half.deadline) == (7.0, 9.5)
    budget.check()
    with pytest.raises(DeadlineError):
        Budget(0.0, 7.0, lambda: 7.0).check()


# --- episodes in common ------------------------------------------------------------------------


def test_replicas_of_an_episode_share_its_numbers():
    numbers = CommonNumbers(np.random.default_rng(3), np.array([0, 1, 0, 1]))
    drawn = numbers.random((2, 4))
    np.testing.assert_array_equal(drawn[:, :2], drawn[:, 2:])
    np.testing.assert_array_equal(drawn[:, :2], np.random.default_rng(3).random((2, 2)))


def test_policies_that_play_alike_return_the_same_and_more_episodes_keep_the_first(lake):
    evaluator = Evaluator(Simulator(lake), 5)
    play = constant_pump(30.0)
    few = evaluator.more(play, np.zeros(0), none)
    more = evaluator.more(play, few, none)
    assert (len(few), len(more)) == (FEWEST, 2 * FEWEST)
    np.testing.assert_array_equal(more[:FEWEST], few)
    np.testing.assert_array_equal(evaluator.more(constant_pump(30.0), np.zeros(0), none), few)
    others = evaluator.more(play, np.zeros(0), none, CONFIRMATION)
    assert not np.any(others == few)
    assert len(np.unique(more)) == 2 * FEWEST


def constant_pump(value):
    return lambda step, observation: {"pump": np.full(1, value)}


def test_an_episode_with_an_error_is_worth_less_the_earlier_it_ends(one_sided):
    simulator = Simulator(one_sided)

    def late(step, observation):
        return {"move": np.full(1, -1.0 if step == 3 else 0.0)}

    early = worth(simulator, constant(-1.0), 2, 0, none)
    np.testing.assert_array_equal(early, [lost_worth(1.0)] * 2)
    np.testing.assert_array_equal(worth(simulator, late, 2, 0, none), [lost_worth(0.4)] * 2)
    np.testing.assert_array_equal(worth(simulator, constant(0.0), 2, 0, none), [-15.0] * 2)


# --- weights as a vector -----------------------------------------------------------------------


def test_a_vector_and_the_parameters_that_it_stands_for():
    params = {"shared": {"a": np.arange(3.0)}, "own": {"a": {"bias": np.array([7.0, 8.0])}}}
    mask = np.array([True, False, True])
    weights_of = Weights(params, {"shared": {"a": mask}, "own": {"a": {"bias": True}}})
    np.testing.assert_array_equal(weights_of.start, [0.0, 2.0, 7.0, 8.0])
    one = weights_of.params(np.array([5.0, 6.0, 1.0, 2.0]))
    np.testing.assert_array_equal(one["shared"]["a"], [5.0, 1.0, 6.0])
    np.testing.assert_array_equal(one["own"]["a"]["bias"], [1.0, 2.0])
    np.testing.assert_array_equal(params["shared"]["a"], np.arange(3.0))
    many = weights_of.batch(np.array([[5.0, 6.0, 1.0, 2.0], [0.0, 0.0, 0.0, 9.0]]), 2)
    # a policy's episodes are side by side
    np.testing.assert_array_equal(many["own"]["a"]["bias"], [[1.0, 1.0, 0.0, 0.0], [2, 2, 9, 9]])
    np.testing.assert_array_equal(many["shared"]["a"][1], [1.0] * 4)


# --- probing -----------------------------------------------------------------------------------


def test_probing_finds_the_unit_and_the_scale(lake):
    seen = probe(lake, Simulator(lake), 0)
    # pumping 300 in the first step, of eight, is best among powers of the square root of ten
    assert seen.units == {"pump": pytest.approx(10**1.5)}
    center, scale = seen.state_scales["depth"]
    assert 400.0 < center < 700.0
    assert 20.0 < scale < 200.0
    assert not seen.is_certain
    assert seen.means[0] == pytest.approx(-8 * 300.0, rel=0.1)


def test_probing_sees_the_side_that_raises_no_error(one_sided):
    seen = probe(one_sided, Simulator(one_sided), 0)
    assert seen.units == {"move": 1.0}
    assert seen.means.max() > -10.0
    assert np.sum(seen.means < LOST / 100) > 5


# --- turns -------------------------------------------------------------------------------------


def test_whoever_applies_has_a_slice_then_the_most_promising(lake):
    arms = [
        counting("poor", lambda n: -1e6),
        counting("rising", lambda n: -2000.0 + 10.0 * n),
        Arm("absent", lambda context: None, lambda context, state, turn: state),
    ]
    outcome = played(lake, arms=lambda: arms)
    slices = {each.name: each.slices for each in outcome.arms}
    assert slices.keys() == {"poor", "rising"}
    # one in eight is for the one that has waited longest
    assert 1 < slices["poor"] <= 2 + slices["rising"] // 4
    assert outcome.chosen.label == CONSTANT


def test_nobody_waits_for_what_is_not_ready(lake):
    arms = [counting("late", lambda n: 0.0, ready_after=5), counting("works", lambda n: 0.0)]
    late, works = played(lake, arms=lambda: arms).arms
    assert late.slices
    assert works.slices > late.slices


def test_a_race_ends_where_nobody_has_anything_left_to_do(lake):
    def step(context, state, turn):
        return state._replace(is_exhausted=True, iterations=1)

    outcome = played(lake, seconds=1e9, arms=lambda: [Arm("once", lambda c: Counting(), step)])
    assert [each.slices for each in outcome.arms] == [1]
    assert not outcome.interrupted


def test_an_interrupted_race_keeps_its_leader(lake):
    def step(context, state, turn):
        raise Cancelled

    outcome = played(lake, arms=lambda: [Arm("stops", lambda c: Counting(), step)])
    assert outcome.interrupted
    assert outcome.chosen.label == CONSTANT
    assert [point.candidate.label for point in outcome.points] == [NOOP, CONSTANT]


def test_the_same_seed_is_the_same_race(lake):
    def run():
        outcome = played(lake, seconds=3000.0, arms=lambda: [weights.rules()])
        return [(point.candidate.label, point.mean) for point in outcome.points]

    assert run() == run()


# --- what is found -----------------------------------------------------------------------------


def test_a_rule_is_found_and_confirmed_by_other_episodes(lake):
    arms = [weights.rules(), weights.shared_weights(), weights.own_weights()]
    outcome = race(lake, auto_preset(""), Budget.of(1.5), 0, RaceOptions(arms=lambda: arms))
    # the lake is held at its level: what is left is the noise of one step, and the way there
    assert outcome.confirmed.mean() > -1100.0
    assert outcome.noop_return == pytest.approx(-2400.0, rel=0.1)
    assert outcome.late_gain is not None
    figures = outcome.diagnostics()
    assert figures["arms"].keys() == {"random rules", "shared weights", "own weights"}


def test_the_side_without_errors_is_learnt(one_sided):
    arms = [weights.rules(), weights.shared_weights(), weights.own_weights()]
    outcome = race(one_sided, auto_preset(""), Budget.of(1.5), 0, RaceOptions(arms=lambda: arms))
    # 3 to the goal at first, and little after that; the no-op returns -15
    assert outcome.confirmed.mean() > -6.0
