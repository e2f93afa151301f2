"""The optimum of the underlying MDP, and what errors of the environment cost in it."""

import dataclasses

import pytest
from helpers.boiler import boiler
from helpers.clocks import Stopped
from helpers.lakes import preset
from helpers.toys import toy
from helpers.umbrella import voting

from mdpo_rddl.auto import RaceOptions
from mdpo_rddl.auto.arms.dynamic_programming import DynamicProgrammingArm
from mdpo_rddl.auto.hidden.underlying_optimum import underlying_optimum
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import Problem, make_environment
from mdpo_rddl.problem.underlying import underlying_mdp

LONG = preset(100.0)


def found(problem: Problem, underlying: Problem, stages: list[str] | None = None):
    """The optimum of the underlying MDP, if there is one."""
    told = [] if stages is None else stages
    options = RaceOptions(clock=Stopped(), on_stage=told.append)
    return underlying_optimum(problem, underlying, LONG, 3, options, 500.0)


@pytest.mark.parametrize(("deadline", "until"), [(500.0, 25.0), (5.0, 5.0)])
def test_it_has_a_share_of_the_time_that_is_left(monkeypatch, deadline, until):
    asked = []
    monkeypatch.setattr(DynamicProgrammingArm, "work", lambda arm, until: asked.append(until))
    options, underlying = RaceOptions(clock=Stopped()), voting().underlying.problem
    given = toy("umbrella"), underlying, LONG, 0, options
    assert underlying_optimum(*given, deadline) is None
    assert asked == [until]


def test_errors_of_the_environment_are_avoided_if_it_raises_any():
    problem, stages = boiler(), []
    underlying = underlying_mdp(problem)
    free = found(boiler(raises=False), underlying, stages)
    # 0 + 1 + 2 + 3 + 3 + 3, and 0 + 1 + 2 twice
    assert (free.optimum.value, stages) == (12.0, ["enumerating"])
    careful = found(problem, underlying)
    assert (careful.optimum.value, careful.seed) == (6.0, 3)
    assert careful.problem.error_cost == 1200.0
    env = make_environment(underlying)
    assert list(evaluate(env, careful, episodes=2, seed=0).returns) == [6.0, 6.0]


@pytest.mark.parametrize(
    "problem",
    [
        boiler(hiss="Binomial(Bernoulli(0.5), 0.5) > 0"),
        dataclasses.replace(toy("umbrella"), raises=True),
        boiler(reward="0.0"),
    ],
    ids=["unknown", "no law", "no reward"],
)
def test_nothing_is_found_where_errors_have_no_cost(problem):
    stages = []
    assert found(problem, underlying_mdp(problem), stages) is None
    # no time is spent where it is known beforehand
    is_known = problem.domain_name == "boiler" and "Binomial" not in problem.domain_text
    assert stages == (["enumerating"] if is_known else [])


def test_the_next_state_may_be_what_an_observation_fails_by():
    problem = boiler(hiss="Bernoulli(0.5 * (sum_{?p : pressure} [VALUE(?p) * at'(?p)]))")
    # the gauge fails one step later
    assert found(problem, underlying_mdp(problem)).optimum.value == 6.0
