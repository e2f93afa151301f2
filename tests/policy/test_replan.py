"""Planning online: budgets, warm starts and what a run leaves behind."""

import csv
import json
import time

import pytest
from helpers.problems import JAXPLAN_EXAMPLES, tiny_files

from mdpo_rddl.cli.plan import main
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.policy.replanning import OnlinePolicy
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import load_problem, make_environment


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return tiny_files(tmp_path_factory.mktemp("tiny"), horizon=4, spread=0.3)


@pytest.fixture(scope="module")
def problem(files):
    return load_problem(*files)


@pytest.fixture(scope="module")
def planner(problem):
    config = PRESETS["paper"](problem.domain_name)
    config = config.with_values(
        "Planner", method="JaxStraightLinePlan", method_kwargs={}, rollout_horizon=3
    )
    return build_planner(problem, config)


def played(problem, planner, episodes=2, **budget):
    policy = OnlinePolicy(planner, 0, Budget(**{"iterations": 999, "seconds": 1e9, **budget}))
    env = make_environment(problem, enforce_action_constraints=True)
    policy.compile(env.reset(seed=0)[0])
    return policy, evaluate(env, policy, episodes, seed=0)


def test_every_decision_has_its_iterations_and_each_episode_starts_cold(problem, planner):
    policy, found = played(problem, planner, iterations=5)
    assert [(d.episode, d.step) for d in policy.decisions] == [
        (episode, step) for episode in range(2) for step in range(4)
    ]
    assert {d.iterations for d in policy.decisions} == {5}
    assert found.lengths.tolist() == [4, 4]
    # the second episode's first decision does not know the first episode's plan
    again, _ = played(problem, planner, iterations=5, episodes=1)
    assert [d.best_return for d in again.decisions] == [d.best_return for d in policy.decisions[:4]]


def test_compilation_eats_no_decision_s_budget(problem, planner):
    policy, _ = played(problem, planner, episodes=1, iterations=10**6, seconds=0.2)
    assert all(d.iterations > 3 for d in policy.decisions)
    assert all(0.2 <= d.seconds < 1.5 for d in policy.decisions)


def test_a_warm_start_goes_on_from_the_plan_moved_by_one_step(problem, planner):
    policy = OnlinePolicy(planner, 0, Budget(3, 1e9))
    env = make_environment(problem)
    state, _ = env.reset(seed=0)
    policy(0, state)
    params = policy._controller.callback["best_params"]
    guess = policy._controller.guess
    assert guess["push"][:2].tolist() == params["push"][1:].tolist()


def test_the_command_replans_and_says_how(files, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    started = time.perf_counter()
    status = main(
        [
            *files,
            *["--replan", "--horizon", "3", "--lookahead", "2", "--seconds", "0.1"],
            *["--episodes", "1", "--json", "--out", "run"],
        ]
    )
    elapsed = time.perf_counter() - started
    assert status == 0
    printed = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert printed == json.loads((tmp_path / "run" / "summary.json").read_text())
    assert (printed["mode"], printed["policy"], printed["noise"]) == ("replan", "slp", "adaptive")
    assert (printed["lookahead"], printed["decisions"], printed["horizon"]) == (2, 3, 3)
    assert printed["decision_seconds"] == 0.1
    assert printed["illegal_actions"] == 0
    assert 0.0 < printed["compile_seconds"] < elapsed
    rows = list(csv.DictReader((tmp_path / "run" / "decisions.csv").open()))
    assert [row["step"] for row in rows] == ["0", "1", "2"]
    assert printed["max_seconds"] == max(float(row["seconds"]) for row in rows)


@pytest.mark.long
def test_jaxplan_s_own_replanning_configuration_runs(files, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    config = JAXPLAN_EXAMPLES / "configs" / "default_replan.cfg"
    options = f"--replan --config {config} --horizon 2 --seconds 0.1".split()
    assert main([*files, *options, "--batch", "2", "--episodes", "1", "--quiet", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert (printed["lookahead"], printed["decision_iterations"]) == (5, 2000)


def test_replanning_does_not_go_with_a_saved_policy(files, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([*files, "--replan", "--load", "nowhere"]) == 2
    message = "mdpo-plan: error: --replan does not go with --load, which plans nothing\n"
    assert capsys.readouterr().err == message
