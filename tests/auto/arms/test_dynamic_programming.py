"""Exact dynamic programming as the first arm: when it ends the race, and when it does not."""

import json

import pytest
from helpers import toy_mdps as toys
from helpers.clocks import Ticking
from helpers.lakes import preset, write_lake
from helpers.problems import write_corridor

from mdpo_rddl import evaluate, make_environment
from mdpo_rddl.auto import RaceOptions, plan_automatically
from mdpo_rddl.auto.arms import dynamic_programming
from mdpo_rddl.auto.arms.dynamic_programming import PROVEN, DynamicProgrammingArm
from mdpo_rddl.auto.outcome import first_policy
from mdpo_rddl.auto.race import race
from mdpo_rddl.auto.search.optimum import Solution
from mdpo_rddl.errors import InputError
from mdpo_rddl.policy.table_policy import TablePolicy
from mdpo_rddl.problem.enumeration.discrete import is_discrete
from mdpo_rddl.problem.enumeration.limits import NotEnumerableError
from mdpo_rddl.problem.load import load_problem


def too_many_states(*arguments):
    raise NotEnumerableError("too many states")


def refuse(*arguments, **keywords):
    raise AssertionError("asked for")


class ProbingReached(BaseException):
    """Ends a race where the other arms would begin."""


@pytest.fixture
def without_other_arms(monkeypatch):
    def reached(*arguments):
        raise ProbingReached

    monkeypatch.setattr(race, "_arena", reached)


def raced(problem, seconds=1000.0, **search):
    options = RaceOptions(clock=Ticking(0.01))
    return plan_automatically(problem, preset(seconds, **search), 3, options)


@pytest.mark.usefixtures("without_other_arms")
def test_a_proven_optimum_ends_the_race(tmp_path):
    problem = toys.walk(tmp_path, 6)
    outcome = raced(problem)
    assert isinstance(outcome.policy, TablePolicy)
    assert outcome.policy.seed == 3
    assert outcome.optimum.value == pytest.approx(-2.9375, abs=1e-12)
    assert outcome.chosen.label == PROVEN
    assert outcome.noise_log is None
    diagnostics = outcome.diagnostics()
    assert diagnostics["late_gain"] is None
    assert diagnostics["arms"]["dynamic programming"]["best_return"] == outcome.optimum.value
    assert diagnostics["arms"]["dynamic programming"]["iterations"] == 6
    (candidate,) = diagnostics["candidates"]
    assert candidate["mean_return"] == outcome.optimum.value
    assert candidate["became_incumbent"]


@pytest.mark.usefixtures("without_other_arms")
def test_one_that_is_proven_when_the_race_is_stopped_is_the_result(tmp_path, monkeypatch):
    made = Solution.policy

    def interrupted(solution, seed=0):
        monkeypatch.setattr(Solution, "policy", made)
        raise KeyboardInterrupt

    monkeypatch.setattr(Solution, "policy", interrupted)
    outcome = raced(toys.walk(tmp_path, 6))
    assert outcome.interrupted
    assert outcome.optimum.value == pytest.approx(-2.9375, abs=1e-12)


@pytest.mark.usefixtures("without_other_arms")
def test_without_a_share_of_the_time_it_is_not_tried(tmp_path, monkeypatch):
    monkeypatch.setattr(dynamic_programming, "find_optimum", refuse)
    with pytest.raises(ProbingReached):
        raced(toys.walk(tmp_path, 6), optimum_until=0.0)


@pytest.mark.usefixtures("without_other_arms")
@pytest.mark.parametrize("write", [write_lake, write_corridor])
def test_a_continuous_problem_never_tries_it(tmp_path, monkeypatch, write):
    monkeypatch.setattr(race, "DynamicProgrammingArm", refuse)
    with pytest.raises(ProbingReached):
        raced(write(tmp_path))


def test_what_is_not_observed_is_not_discrete(tmp_path):
    assert is_discrete(toys.gambler(tmp_path, 3))
    assert is_discrete(load_problem("Elevators_MDP_ippc2011", "1"))
    assert not is_discrete(load_problem("Elevators_POMDP_ippc2011", "1"))


def test_too_little_time_is_said_and_costs_no_more_than_the_share(tmp_path):
    clock = Ticking(1.0)
    arm = DynamicProgrammingArm(toys.walk(tmp_path, 6), preset(1.0), clock)
    arm.work(5.0)
    assert arm.solution is None
    assert arm.take_candidates() == []
    assert clock.now < 12.0
    assert arm.log.details["cause"].startswith("more than ")
    assert arm.log.best_return is None


def test_a_failure_of_the_enumeration_is_the_arms_alone(tmp_path, monkeypatch):
    def broken(*arguments):
        raise MemoryError("too much")

    monkeypatch.setattr(dynamic_programming, "find_optimum", broken)
    arm = DynamicProgrammingArm(toys.walk(tmp_path, 6), preset(1.0), Ticking())
    arm.work(1e9)
    assert arm.log.details == {"cause": "MemoryError: too much"}


@pytest.mark.usefixtures("without_other_arms")
@pytest.mark.parametrize("place", ["find_optimum", "_arena"])
def test_an_interrupt_before_any_other_arm_leaves_the_no_op(tmp_path, monkeypatch, place):
    told = []

    def interrupted(*arguments):
        # whoever listens knows of the no-op by then
        assert [judged.candidate.label for judged in told] == ["no-op"]
        raise KeyboardInterrupt

    room = race if place == "_arena" else dynamic_programming
    monkeypatch.setattr(room, place, interrupted)
    problem = toys.walk(tmp_path, 6)
    if place == "_arena":
        monkeypatch.setattr(dynamic_programming, "find_optimum", too_many_states)
    options = RaceOptions(clock=Ticking(0.01), on_judged=told.append)
    outcome = plan_automatically(problem, preset(1000.0), 3, options)
    assert outcome.interrupted
    assert outcome.optimum is None
    assert outcome.chosen.label == "no-op"
    env = make_environment(problem)
    played = evaluate(env, outcome.policy, episodes=4, seed=3)
    assert played.mean == outcome.noop_return == outcome.chosen.mean == -6.0
    json.dumps(outcome.diagnostics(), allow_nan=False)


@pytest.mark.usefixtures("without_other_arms")
def test_an_interrupt_without_any_policy_ends_everything(tmp_path, monkeypatch):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    def refuse_to_build(*arguments):
        raise InputError("no such function")

    monkeypatch.setattr(first_policy, "build_planner", refuse_to_build)
    monkeypatch.setattr(dynamic_programming, "find_optimum", interrupted)
    with pytest.raises(KeyboardInterrupt):
        raced(toys.walk(tmp_path, 6))


@pytest.mark.long
def test_a_problem_too_large_goes_on_with_the_other_arms_within_its_time(tmp_path):
    # the share ends before the first step backward
    clock = Ticking(1.0)
    options = RaceOptions(clock=clock, most_iterations=20)
    config = preset(300.0, optimum_until=0.02, rounds_until=0.45, without=["trials"])
    outcome = plan_automatically(toys.walk(tmp_path, 6), config, 0, options)
    assert outcome.optimum is None
    assert outcome.arms[0].name == "dynamic programming"
    assert "cause" in outcome.arms[0].details
    assert len(outcome.arms) > 1
    assert outcome.policy.config.section("Planner")["method"] == "FeedbackPlan"
    # the arms look at the clock between iterations only
    assert outcome.seconds < 1.5 * 300.0
