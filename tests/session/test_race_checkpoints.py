"""What a race leaves behind is what the next one begins with."""

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import toy_mdps as toys
from helpers.mistakes import one_line
from helpers.problems import assert_same_bits
from helpers.race_checkpoints import CONFIG, FORMAT, PARAMS, arena, judged, kept, terms

from mdpo_rddl.auto.common import curve as curves
from mdpo_rddl.auto.common.candidate import Candidate, Judged
from mdpo_rddl.auto.common.curve import candidate_figures
from mdpo_rddl.auto.search.optimum import find_optimum
from mdpo_rddl.policy.container import read_container, write_container
from mdpo_rddl.policy.plan_rule import PlanRule, Simulated
from mdpo_rddl.policy.table import Estimate, table_tensors
from mdpo_rddl.session.race_checkpoints import RaceCheckpoints


def test_nothing_is_there_before_the_first_candidate(tmp_path):
    assert kept(tmp_path) is None
    assert list(tmp_path.iterdir()) == []


def test_the_incumbent_comes_back_with_the_seconds(tmp_path):
    start = kept(tmp_path, judged(-5.0, 1.0), judged(-3.0, 4.0), judged(-9.0, 6.0, False))
    found = start.incumbent
    assert (found.mean, found.error, start.seconds) == (-3.0, 0.5, 4.0)
    assert (found.arm, found.label, found.parents) == ("plan", "a plan", ("rules",))
    assert found.uses_noise
    assert_same_bits(found.params, {**PARAMS, "b": np.full(2, -3.0, np.float32)})
    assert start.others == ()


def test_each_arm_s_best_policy_comes_back(tmp_path):
    arms = [("slp", -6.0, True), ("plan", -5.0, True), ("slp", -9.0, False), ("drp", -np.inf, 0)]
    found = [
        judged(mean, second, bool(is_best), arm=arm)
        for second, (arm, mean, is_best) in enumerate(arms)
    ]
    start = kept(tmp_path, *found, seconds=0.0)
    assert (start.incumbent.arm, start.incumbent.mean, start.seconds) == ("plan", -5.0, 3.0)
    # no policy has the mean of the diverged one
    assert [(other.arm, other.mean) for other in start.others] == [("slp", -6.0)]
    here = arena(CONFIG, ((2, 3), (2,)))
    assert [candidate.arm for candidate in start.candidates(here)] == ["plan", "slp"]


def test_seconds_are_kept_between_incumbents_too(tmp_path):
    start = kept(tmp_path, judged(-5.0, 1.0), judged(-9.0, 6.0, False), seconds=0.0)
    assert (start.incumbent.mean, start.seconds) == (-5.0, 6.0)


def test_the_curve_of_all_processes_comes_back(tmp_path):
    kept(tmp_path, judged(-5.0, 1.0), judged(-9.0, 2.0, False))
    start = kept(tmp_path, judged(-5.0, 2.5), judged(-3.0, 4.0))
    points = [(p["seconds"], p["mean_return"], p["became_incumbent"]) for p in start.curve]
    # the second candidate did not become the incumbent, and was not written by itself
    assert points == [(1.0, -5.0, True), (2.5, -5.0, True), (4.0, -3.0, True)]
    assert start.curve[-1] == candidate_figures(judged(-3.0, 4.0))


@pytest.mark.parametrize(
    "change",
    [
        {"seconds": 0.5},
        {"seconds": 9.0},
        {"seconds": float("nan")},
        {"mean_return": "much"},
        {"error": float("inf")},
        {"became_incumbent": 1},
        {"arm": None},
    ],
)
def test_a_curve_that_is_none_is_refused(tmp_path, change):
    kept(tmp_path, judged(-5.0, 1.0), judged(-3.0, 4.0))
    path = tmp_path / "incumbent-1.safetensors"
    text, tensors = read_container(path, (FORMAT,))
    curve = json.loads(text["curve"])
    curve[1].update(change)
    write_container(path, tensors, {**text, "curve": json.dumps(curve)})
    (tmp_path / "incumbent-0.safetensors").unlink()
    said = one_line(lambda: RaceCheckpoints(tmp_path, terms(), 1.0))
    assert said.startswith(f"{path}: damaged checkpoint: ")


def test_a_long_curve_keeps_its_incumbents(monkeypatch):
    monkeypatch.setattr(curves, "MOST_POINTS", 3)
    points = [candidate_figures(judged(-9.0, 1.0 + each, each % 2 == 0)) for each in range(9)]
    assert curves.shortened(points[:3]) == tuple(points[:3])
    assert curves.shortened(points[:4]) == (points[0], points[2])
    assert [point["seconds"] for point in curves.shortened(points)] == [5.0, 7.0, 9.0]
    with pytest.raises(ValueError, match="its candidates are 4"):
        curves.read_curve(points[:4], 100.0)


@pytest.mark.parametrize("state", [json.dumps({"race": {"seconds": 9.0}}), "damaged"])
def test_the_arms_states_of_an_earlier_version_are_ignored(tmp_path, state):
    kept(tmp_path, judged(-5.0, 1.0))
    (path,) = tmp_path.iterdir()
    text, tensors = read_container(path, (FORMAT,))
    tensors["state/arm/plan/elites"] = np.ones((2, 3))
    write_container(path, tensors, {**text, "state": state})
    start = RaceCheckpoints(tmp_path, terms(), 60.0).start
    assert (start.incumbent.mean, start.seconds) == (-5.0, 1.0)
    assert_same_bits(start.incumbent.params, {**PARAMS, "b": np.full(2, -5.0, np.float32)})


@pytest.fixture
def table(tmp_path):
    problem = toys.walk(tmp_path, 4)
    found = find_optimum(problem, 30)
    estimate = Estimate(2.5, 0.1, 512, 0.0, found.optimum.states)
    arena = SimpleNamespace(problem=problem, seed=3)
    return arena, Candidate(
        "trials", "trials", CONFIG, None, None, table=(found.table, estimate), mean=2.5, error=0.1
    )


def test_a_table_comes_back(tmp_path, table):
    arena, candidate = table
    folder = tmp_path / "kept"
    folder.mkdir()
    start = kept(folder, judged(-5.0, 1.0), Judged(candidate, 2.0, became_incumbent=True))
    found = start.incumbent.candidate(arena)
    assert (found.arm, found.mean, found.error) == ("trials", 2.5, 0.1)
    assert_same_bits(table_tensors(found.table[0]), table_tensors(candidate.table[0]))
    assert found.table[1] == candidate.table[1]
    assert [other.arm for other in start.others] == ["plan"]


def test_relaxed_plans_come_back(tmp_path, table):
    arena, _ = table
    plans = PlanRule(0.5, 0.25), Simulated(3.5, 0.2, 16)
    own = {"plans": plans, "mean": 3.5, "error": 0.2}
    candidate = Candidate("relaxed plans", "relaxed plans", CONFIG, None, None, **own)
    folder = tmp_path / "kept"
    folder.mkdir()
    start = kept(folder, judged(-5.0, 1.0), Judged(candidate, 2.0, became_incumbent=True))
    found = start.incumbent.candidate(arena)
    assert (found.arm, found.mean, found.error, found.plans) == ("relaxed plans", 3.5, 0.2, plans)
    assert found.table is None


def test_a_table_of_other_fluents_is_refused(tmp_path, table):
    arena, candidate = table
    folder, other = tmp_path / "kept", tmp_path / "other"
    folder.mkdir()
    other.mkdir()
    start = kept(folder, Judged(candidate, 2.0, became_incumbent=True))
    arena.problem = toys.lamp(other, 3)
    said = one_line(lambda: start.incumbent.candidate(arena))
    assert said == "the checkpoint: damaged policy file: its fluents are not the problem's"


def test_a_damaged_file_leaves_the_one_before(tmp_path):
    kept(tmp_path, judged(-5.0, 1.0), judged(-3.0, 4.0))
    newest = tmp_path / "incumbent-1.safetensors"
    newest.write_bytes(newest.read_bytes()[:-1])
    assert RaceCheckpoints(tmp_path, terms(), 1.0).start.incumbent.mean == -5.0


def test_a_checkpoint_without_a_number_is_refused_and_not_overwritten(tmp_path):
    kept(tmp_path, judged(-5.0, 1.0))
    (path,) = tmp_path.iterdir()
    text, tensors = read_container(path, (FORMAT,))
    write_container(path, tensors, {**text, "number": "-1"})
    said = one_line(lambda: RaceCheckpoints(tmp_path, terms(), 1.0))
    assert said.startswith(f"{path}: damaged checkpoint: ValueError('number -1')")


def test_another_problem_s_is_refused(tmp_path):
    kept(tmp_path, judged(-5.0, 1.0))
    for others, name in (({"digest": "e"}, "problem"), ({"seed": 4}, "seed")):
        said = one_line(lambda others=others: RaceCheckpoints(tmp_path, terms(**others), 1.0))
        assert said.endswith(f"cannot be resumed: it is of another {name}")


@pytest.mark.parametrize("shapes", [((2, 3), (2,)), ((2, 3), (3,))])
def test_a_policy_of_the_new_race_s_planner_is_judged_anew(tmp_path, shapes):
    start = kept(tmp_path, judged(-5.0, 1.0))
    here = arena(CONFIG.with_section("Noise", {"method": "NoNoise"}), shapes)
    candidate = start.incumbent.candidate(here)
    fits = shapes[1] == (2,)
    assert candidate.planner is (here.planner if fits else None)
    assert candidate.mean == (None if fits else -5.0)


def test_on_a_large_problem_it_keeps_its_return(tmp_path):
    start = kept(tmp_path, judged(-5.0, 1.0))
    here = arena(CONFIG, ((2, 3), (2,)))
    here.probe.policy_seconds = 2.0
    candidate = start.incumbent.candidate(here)
    assert (candidate.planner, candidate.mean) == (here.planner, -5.0)


def test_a_policy_of_another_planner_keeps_its_return(tmp_path):
    start = kept(tmp_path, judged(-5.0, 1.0))
    other = CONFIG.with_values("Compiler", sigmoid_weight=7)
    candidate = start.incumbent.candidate(arena(other, ((2, 3), (2,))))
    assert candidate.planner is None
    assert (candidate.known_mean, candidate.error) == (-5.0, 0.5)
    assert dataclasses.replace(candidate).config.to_text() == CONFIG.to_text()


def test_an_estimate_without_an_error_is_no_candidate_of_the_next_race(tmp_path):
    guess = judged(-5.0, 1.0)
    guess = dataclasses.replace(guess, candidate=dataclasses.replace(guess.candidate, error=np.inf))
    start = kept(tmp_path, guess)
    assert start.incumbent.mean == -5.0
    here = arena(CONFIG, ((2, 3), (2,)))
    assert [candidate.mean for candidate in start.candidates(here)] == [None]
    other = CONFIG.with_values("Compiler", sigmoid_weight=7)
    assert start.candidates(arena(other, ((2, 3), (2,)))) == []


def test_a_race_that_goes_on_keeps_what_it_began_with_until_there_is_something_better(tmp_path):
    assert kept(tmp_path, judged(-3.0, 4.0)).incumbent.mean == -3.0
    # its own no-op, an estimate of a few episodes, then its first policies
    guess = judged(-1.0, 4.5)
    vague = dataclasses.replace(guess.candidate, error=np.inf)
    guess = dataclasses.replace(guess, candidate=vague)
    assert kept(tmp_path, guess, judged(-8.0, 5.0)).incumbent.mean == -3.0
    assert kept(tmp_path, judged(-8.0, 6.0), judged(-2.0, 7.0)).incumbent.mean == -2.0
