"""Planning online: budgets, warm starts and what a run leaves behind."""

import csv
import json
import time
from pathlib import Path
from unittest.mock import create_autospec

import numpy as np
import pytest
from helpers.mistakes import one_line
from helpers.problems import JAXPLAN_EXAMPLES, tiny_files
from helpers.toys import toy

from mdpo_rddl.cli.plan import main
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.policy.replanning import OnlinePolicy
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import load_problem, make_environment
from mdpo_rddl.problem.played import NotPlayedError, PlayedSimulator
from mdpo_rddl.session.replan import replan
from mdpo_rddl.session.report.page.record import read_play, read_run
from mdpo_rddl.session.requests import PlanRequest, Reporter


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
    assert all(d.seconds >= 0.2 for d in policy.decisions)


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


ENDED = """
domain ended {
    types { boat : object; };
    pvariables {
        x(boat) : { state-fluent, real, default = 0.0 };
        pull(boat) : { action-fluent, real, default = 0.0 };
    };
    cpfs { x'(?b) = x(?b) + pull(?b); };
    reward = sum_{?b : boat} [x(?b)];
    action-preconditions { forall_{?b : boat} [pull(?b) >= -1.0 ^ pull(?b) <= 1.0]; };
    termination { forall_{?b : boat} [x(?b) <= 0.0]; };
}
"""
ENDED_INSTANCE = """
non-fluents nf { domain = ended; objects { boat : {a, b}; }; }
instance one { domain = ended; non-fluents = nf; horizon = 3; discount = 1.0; }
"""
REPLAN = "--replan --horizon 3 --lookahead 2 --seconds 0.01 --episodes 2 --json --quiet --out run"


def failing_at(monkeypatch, call, error):
    """Has one of the decisions raise, compilation's own not counted."""
    calls, sample = [], OnlinePolicy.__call__

    def decide(policy, step, state):
        calls.append(step)
        if len(calls) == call:
            raise error
        return sample(policy, step, state)

    monkeypatch.setattr(OnlinePolicy, "__call__", decide)


@pytest.mark.parametrize(("call", "ended"), [(3, 0), (5, 1)])
def test_an_error_leaves_what_was_planned_until_then(
    files, tmp_path, monkeypatch, capsys, call, ended
):
    monkeypatch.chdir(tmp_path)
    failing_at(monkeypatch, call, ValueError("no\nplan"))
    assert main([*files, *REPLAN.split()]) == 2
    step = call - 1 - 3 * ended
    cause = (
        f"{files[0]}, {files[1]}: episode {ended + 1}, step {step}: "
        "cannot be planned: ValueError: no plan"
    )
    said = f"mdpo-plan: error: {cause}; what was planned until then is in run\n"
    assert capsys.readouterr() == ("", said)
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert (summary["status"], summary["cause"], summary["episodes"]) == ("failed", cause, ended)
    assert (len(summary["returns"]), summary["decisions"]) == (ended, call - 1)
    assert summary["unfinished_episode"]["steps"] == step
    rows = list(csv.DictReader((tmp_path / "run" / "decisions.csv").open()))
    assert [int(row["step"]) for row in rows] == [number % 3 for number in range(call - 1)]
    plays, _ = read_play(tmp_path / "run" / "trajectories.npz")
    rewards = plays["policy"].rewards
    assert np.isfinite(rewards).sum(axis=1).tolist() == [3] * ended + [step]
    if ended:
        np.testing.assert_allclose(rewards[0].sum(), summary["returns"][0], rtol=1e-5)
        read_run(tmp_path / "run")
        assert (tmp_path / "run" / "report.html").is_file()
    else:
        told = cause.replace(f"{Path(files[0]).parent}/", "")  # a page names no folders
        assert one_line(lambda: read_run(tmp_path / "run")).endswith(f"not played: {told}")


def test_an_environment_that_fails_leaves_what_was_planned_until_then(
    files, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    steps, plain = [], PlayedSimulator.step

    def step(simulator, actions):
        steps.append(actions)
        if len(steps) == 2:
            raise NotPlayedError("the environment fails: ValueError: no")
        return plain(simulator, actions)

    monkeypatch.setattr(PlayedSimulator, "step", step)
    assert main([*files, *REPLAN.split()]) == 2
    cause = f"{files[0]}, {files[1]}: episode 1: the environment fails: ValueError: no"
    said = f"mdpo-plan: error: {cause}; what was planned until then is in run\n"
    assert capsys.readouterr().err == said
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert (summary["not_played"], summary["decisions"]) == (cause, 2)
    assert summary["unfinished_episode"]["steps"] == 1


def test_an_interrupt_leaves_what_was_planned_until_then(files, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    failing_at(monkeypatch, 3, KeyboardInterrupt())
    assert main([*files, *REPLAN.split()]) == 130
    printed, said = capsys.readouterr()
    assert said == "mdpo-plan: stopped early\n"
    assert (json.loads(printed)["status"], json.loads(printed)["decisions"]) == ("interrupted", 2)
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


@pytest.mark.parametrize(("error", "status"), [(ValueError("no"), 2), (KeyboardInterrupt(), 130)])
def test_nothing_is_left_where_there_was_no_decision(
    files, tmp_path, monkeypatch, capsys, error, status
):
    monkeypatch.chdir(tmp_path)
    failing_at(monkeypatch, 1, error)
    assert main([*files, *REPLAN.split()]) == status
    assert capsys.readouterr().err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


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


def test_episodes_that_end_where_they_begin_have_a_page_and_no_decision(
    tmp_path, monkeypatch, capsys
):
    (tmp_path / "d.rddl").write_text(ENDED)
    (tmp_path / "i.rddl").write_text(ENDED_INSTANCE)
    monkeypatch.chdir(tmp_path)
    assert main(["d.rddl", "i.rddl", *REPLAN.replace("--quiet ", "").split()]) == 0
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert (summary["decisions"], summary["mean_return"]) == (0, 0.0)
    for figure in ("mean_iterations", "mean_seconds", "max_seconds"):
        assert summary[figure] is None
    assert (tmp_path / "run" / "report.html").is_file()


def test_a_state_that_is_not_observed_is_refused(tmp_path):
    config = PRESETS["paper"]("tiger")
    request = PlanRequest(toy("tiger"), config, "paper", 0, 1, tmp_path / "run")
    said = one_line(lambda: replan(request, None))
    assert said.endswith(": --replan plans from the state, which is observed in part only")
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_compiled_leaves_no_folder(tmp_path, problem, monkeypatch):
    def failing(self, state):
        raise TypeError("no such shape")

    monkeypatch.setattr(OnlinePolicy, "compile", failing)
    request = PlanRequest(problem, PRESETS["paper"]("tiny"), "paper", 0, 1, tmp_path / "run")
    said = one_line(lambda: replan(request, create_autospec(Reporter)))
    assert said.endswith(": decisions cannot be compiled: TypeError: no such shape")
    assert not list(tmp_path.iterdir())
