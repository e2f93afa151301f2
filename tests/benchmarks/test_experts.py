"""The hand-written rules, worked by hand."""

import numpy as np
import pytest
from helpers.problems import shipped, tiny_files

from benchmarks.presets.experts import expert
from mdpo_rddl.errors import InputError
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import load_problem, make_environment


def test_water_above_the_lowest_wanted_level_is_released():
    problem = shipped("reservoir15", 2)
    level = np.array(problem.model.non_fluents["MIN_LEVEL"]) + np.arange(15) - 2.0
    action = expert(problem)(0, {"rlevel": level})
    np.testing.assert_allclose(action["release"], [0, 0, *range(13)], atol=1e-9)


def test_cold_zones_get_more_air_and_none_gets_less_than_it_needs():
    problem = shipped("hvac10", 2)
    temperature = np.array([22.0, 20.0, 40.0] + [22.0] * 7)
    flow = expert(problem)(0, {"temp-zone": temperature})["fan-in"]
    np.testing.assert_allclose(flow, [50, 70, 0.05] + [50] * 7)


@pytest.mark.parametrize(
    ("demand", "production"),
    [
        (8.0, [0, 0, 8, 0, 0, 0, 0]),
        (41.0, [0, 0, 20, 20, 1, 0, 0]),
        (53.0, [1, 0, 20, 20, 4, 4, 4]),
    ],
)
def test_the_cheapest_plants_serve_the_demand(demand, production):
    problem = shipped("powergen7", 2)
    # MIN-CONSUMPTION 8 and DEMAND-EXP-COEF 0.04
    temperature = 11.7 + np.sqrt((demand - 8.0) / 0.04)
    action = expert(problem)(0, {"temperature": np.array([temperature])})
    np.testing.assert_allclose(action["curProd"], production, atol=1e-9)


@pytest.mark.parametrize("instance", ["hvac10", "powergen7", "reservoir15"])
def test_the_rules_are_legal(instance):
    problem = shipped(instance, 20)
    env = make_environment(problem, enforce_action_constraints=True)
    assert evaluate(env, expert(problem), episodes=1, seed=0).illegal_actions == 0


def test_other_domains_have_none(tmp_path):
    problem = load_problem(*tiny_files(tmp_path))
    with pytest.raises(InputError, match=r"d\.rddl: no expert"):
        expert(problem)
