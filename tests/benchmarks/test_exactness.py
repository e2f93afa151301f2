"""The compiled exact model and the environment on the same sequences of actions."""

import numpy as np
import pytest
from helpers.workers import in_this_process

from benchmarks.problems import each
from benchmarks.problems.agreement import Episodes, compare, difference
from benchmarks.problems.compatibility import checked_problems, first_instance
from benchmarks.problems.exactness import exactness_table, run_exactness
from mdpo_rddl.machine.guarded import Limits
from mdpo_rddl.problem.load import load_problem

# a termination with invariants; enumerated actions and chance; integers; an illegal no-op
QUICK = ["TSP_or", "Intruders_Discrete", "Pong_arcade", "PushYourLuck_ippc2018"]


@pytest.mark.parametrize(
    "name", [QUICK[0], *(pytest.param(n, marks=pytest.mark.long) for n in QUICK[1:])]
)
def test_the_model_agrees_with_the_environment(name):
    found = compare(load_problem(name, first_instance(name), 15))
    assert found.difference == ""
    assert found.illegal == 0
    assert found.steps > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", checked_problems(None))
def test_every_problem_agrees(name):
    found = compare(load_problem(name, first_instance(name), 20))
    assert (found.difference, found.illegal) == ("", 0)


def same(rewards, length):
    return Episodes(np.array([rewards] * 2, float), np.array([length] * 2))


def test_a_difference_is_told():
    here = same([1.0, 2.0, 3.0], 3)
    assert difference(here, same([1.0, 2.0, 3.0], 3)) == ""
    assert difference(here, same([1.0, 2.5, 3.0], 3)) == "reward 2 at step 1, the environment 2.5"
    assert difference(here, same([1.0, 2.0, 0.0], 2)) == "3 steps, the environment 2"
    random = np.random.default_rng(0)
    wide = Episodes(random.normal(size=(200, 1)), np.ones(200))
    assert difference(wide, Episodes(random.normal(size=(50, 1)), np.ones(50))) == ""
    moved = Episodes(random.normal(size=(50, 1)) + 2.0, np.ones(50))
    assert difference(wide, moved).startswith("mean return")


@pytest.mark.long
def test_a_row_a_problem(tmp_path, monkeypatch):
    monkeypatch.setattr(each, "run_guarded", in_this_process)
    records = run_exactness(tmp_path, ["TSP_or"], 5, Limits(300, 8))
    (row,) = records.rows
    assert (row["status"], row["illegal"], row["horizon"]) == ("ok", "0", "5")
    assert float(row["steps_per_second"]) > 0
    assert "agree on 1 of 1 problems" in exactness_table(records)
    assert run_exactness(tmp_path, ["TSP_or"], 5, Limits(300, 8)).rows == records.rows
