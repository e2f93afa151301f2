"""What the options and a configuration file make of a run of `mdpo-plan`."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from helpers.files import changed
from helpers.plan_command import (
    CONFIG,
    DOMAIN,
    INSTANCE,
    OPTIONS,
    RUN_FILES,
    TANKS,
    Outcome,
    Run,
    history,
    refuse,
    run,
)

from mdpo_rddl.noise import ConstantNoise
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.policy.file import load_policy
from mdpo_rddl.policy.playable import playable
from mdpo_rddl.problem.load import load_problem


def test_another_seed_another_policy_and_no_noise(
    finished: Run, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = f"{OPTIONS} --seed 1 --policy slp --noise none --quiet --json"
    summary = run(options, capsys).summary
    assert [summary[key] for key in ("seed", "policy", "noise")] == [1, "slp", "none"]
    assert summary["noise_parameters"] == {}
    assert not set(summary["returns"]) & set(finished.summary["returns"])
    folder = workplace / "runs" / "two-seed1"
    assert json.loads((folder / "summary.json").read_text()) == summary
    np.testing.assert_array_equal(np.load(folder / "noise.npy"), np.zeros((30, 7)))
    assert set(history(folder)["mean_sigma"]) == {0.0}
    plan = load_policy(folder / "policy.safetensors").params
    assert {name: tensor.shape for name, tensor in plan.items()} == {"fill": (7, 2)}

    # a straight-line plan has its horizon
    said = f"{Path('runs/two-seed1/policy.safetensors')}: damaged policy file, or saved for another"
    load = "--load runs/two-seed1 --episodes 2 --quiet --json"
    refuse(f"{TANKS} {load} --horizon 9", said, workplace, capsys, start=True)
    assert run(f"{TANKS} {load}", capsys).summary["returns"] == summary["returns"][:2]


@pytest.mark.long
def test_constant_noise_restarts_and_a_batch(
    workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = "--noise constant --sigma 2 --restarts 2 --batch 3 --out run --horizon 5 --quiet"
    assert run(f"{OPTIONS} {options}", capsys) == Outcome(0, "", "")
    summary = json.loads((workplace / "run" / "summary.json").read_text())
    assert (summary["noise"], summary["noise_parameters"]) == ("constant", {"sigma": 2.0})
    assert (summary["restarts"], summary["batch"], summary["horizon"]) == (2, 3, 5)
    assert len(summary["returns"]) == 3
    np.testing.assert_array_equal(np.load("run/noise.npy"), np.full((30, 5), 2.0))
    one_policy = load_policy(workplace / "run" / "policy.safetensors").params["params"]
    assert sorted(layer["bias"].shape for layer in one_policy.values()) == [(2,), (12,), (12,)]
    loaded = run(f"{TANKS} --load run --episodes 3 --quiet --json", capsys).summary
    assert loaded["returns"] == summary["returns"]


def test_the_seconds_bound_the_training(
    workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = "--iterations 1000000000 --seconds 1 --episodes 1 --quiet --json"
    summary = run(f"{TANKS} {options}", capsys).summary
    assert summary["status"] == "time_budget_reached"
    assert summary["train_seconds"] >= 1.0
    records = history(workplace / "runs" / "two-seed0")
    assert records["iteration"][-1] == summary["iterations"] - 1
    assert len(records["iteration"]) <= 602


def test_a_configuration_file(
    workplace: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    """With its own noise, seed and horizon, and a name that is markup to rich and matplotlib."""
    (workplace / "my.cfg").write_text(CONFIG)
    (workplace / "a$_$[b].rddl").write_text(INSTANCE)
    outcome = run("tanks.rddl a$_$[b].rddl --config my.cfg --episodes 2 --json", capsys)
    summary = outcome.summary
    assert summary["config"] == "my.cfg"
    assert (summary["noise"], summary["noise_parameters"]) == ("constant", {"sigma": 0.5})
    assert (summary["policy"], summary["seed"], summary["iterations"]) == ("slp", 5, 4)
    assert (summary["batch"], summary["label"]) == (2, "a$_$[b]")
    assert "a$_$[b], horizon 7" in outcome.out
    assert "written to runs/a$_$[b]-seed5" in outcome.out.splitlines()
    folder = workplace / "runs" / "a$_$[b]-seed5"
    assert {path.name for path in folder.iterdir()} == RUN_FILES
    np.testing.assert_array_equal(np.load(folder / "noise.npy"), np.full((4, 3), 0.5))
    saved = load_policy(folder / "policy.safetensors")
    assert PlannerConfig.from_text(saved.config).noise() == ConstantNoise(0.5, unit="absolute")

    # three steps of a plan for seven
    said = "the plan has 3 steps, its last action is repeated up to the horizon 7"
    told, more = [record.getMessage() for record in caplog.records]
    assert told == said
    assert more.startswith("random actions returned more than the policy: ")
    problem = load_problem("tanks.rddl", "two.rddl")
    planner = build_planner(problem, PlannerConfig.from_text(saved.config)).planner
    policy = playable(planner, saved.params, saved.policy_hyperparams, saved.seed)
    state = {"volume": np.array([5.0, 5.0])}
    actions = [policy(step, state)["fill"] for step in range(7)]
    np.testing.assert_array_equal(actions[:3], np.clip(saved.params["fill"], 0.0, 3.0))
    np.testing.assert_array_equal(actions[3:], [actions[2]] * 4)


@pytest.mark.long
def test_a_problem_of_rddlrepository(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = "--horizon 5 --iterations 3 --episodes 2 --sigma-min 1 --quiet --json"
    summary = run(f"Reservoir_ippc2023 1 {options}", capsys).summary
    assert summary["domain"] == "reservoir_control_cont"
    assert summary["instance"] == "inst_reservoir_control_cont_1c"
    assert summary["noise_parameters"]["sigma_min"] == 1.0
    folder = workplace / "runs" / "Reservoir_ippc2023-1-seed0"
    assert json.loads((folder / "summary.json").read_text()) == summary
    # nothing depends on the action yet
    np.testing.assert_array_equal(np.load(folder / "noise.npy"), np.ones((3, 5)))


def test_a_last_iterate_that_diverged_is_said_to_be_not_finite(
    workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its exact return overflows in the second iteration; the first one is still worth having."""
    reward = "sum_{?t : tank} [1000.0 * fill(?t) - exp[3800.0 * fill(?t) - 1300.0]]"
    domain = changed(DOMAIN, "sum_{?t : tank} [-abs[volume(?t) - LEVEL(?t)]]", reward)
    (workplace / "leap.rddl").write_text(domain)
    start = "method_kwargs={'initializer': 'constant', 'initializer_kwargs': {'value': 0.0}}"
    config = changed(CONFIG, "rollout_horizon=3", start)
    config = changed(config, "'ConstantNoise'\nsigma=0.5", "'NoNoise'")
    (workplace / "leap.cfg").write_text(config)
    options = "--config leap.cfg --iterations 2 --episodes 2 --out run --json"
    outcome = run(f"leap.rddl two.rddl {options}", capsys)
    summary = outcome.summary
    assert summary["best_iteration"] == 0
    assert summary["mean_return"] > 0.0
    last = summary["last_iterate"]
    assert (last["mean_return"], last["returns"]) == (None, [None, None])
    assert re.search(r"mean return, last iterate +│ +not finite │", outcome.out)
    assert json.loads((workplace / "run" / "summary.json").read_text()) == summary
