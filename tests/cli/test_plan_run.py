"""One run of `mdpo-plan` from all sides: what it prints and what it leaves behind."""

import json
import re
import statistics
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from helpers.files import contents
from helpers.plan_command import OPTIONS, RUN_FILES, Run, history, in_a_process, write_problem

from mdpo_rddl.planner.config.config import PlannerConfig
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.policy.file import load_policy
from mdpo_rddl.problem.load import load_problem


def test_the_json_line_is_last_on_standard_output_and_is_the_summary(finished: Run) -> None:
    assert finished.outcome.status == 0
    assert finished.outcome.out.endswith("}\n")
    assert finished.outcome.summary == finished.summary


def test_the_table_comes_before_it_with_the_same_figures(finished: Run) -> None:
    *table, where, _ = finished.outcome.out.splitlines()
    assert where == "written to run"
    rows = dict(re.findall(r"│ (.+?)  +│ +(.+?) │", "\n".join(table)))
    summary = finished.summary
    assert "two, horizon 7" in table[0]
    assert rows["mean return"] == f"{summary['mean_return']:,.2f}"
    low, high = summary["ci95"]
    assert rows["95% interval"] == f"[{low:,.2f}, {high:,.2f}]"
    assert rows["standard deviation"] == f"{summary['std_return']:,.2f}"
    last = summary["last_iterate"]["mean_return"]
    assert rows["mean return, last iterate"] == f"{last:,.2f}"
    assert rows["iterations"] == "30 (iter_budget_reached)"


def test_progress_goes_to_standard_error(finished: Run) -> None:
    lines = [line.split() for line in finished.outcome.err.splitlines() if line.strip()]
    # no terminal, a command that takes long says so
    stages = [words[0] for words in lines if words[0] != "mdpo-plan:"]
    assert stages == ["compiling", "training", "evaluating"]


def test_the_folder_is_complete_and_all_that_is_left(finished: Run) -> None:
    assert {path.name for path in finished.folder.iterdir()} == RUN_FILES
    assert {path.name for path in finished.cwd.iterdir()} == {"tanks.rddl", "two.rddl", "run"}


def test_the_summary_names_the_run(finished: Run) -> None:
    summary = finished.summary
    expected = {
        "domain": "tanks",
        "instance": "two",
        "label": "two",
        "horizon": 7,
        "config": "paper",
        "noise": "adaptive",
        "noise_parameters": {"sigma_min": 0.0, "sigma_max": 10.0, "alpha": 1.0, "quantile": 0.95},
        "policy": "drp",
        "seed": 0,
        "episodes": 3,
        "iterations": 30,
        "restarts": 1,
        "restart": 0,
        "batch": 1,
        "status": "iter_budget_reached",
        "episode_lengths": [7, 7, 7],
        "illegal_actions": 0,
        "fallback_actions": 0,
    }
    assert {key: summary[key] for key in expected} == expected
    measured = {"best_iteration", "train_seconds", "compile_seconds", "device", "versions"}
    returns = {"mean_return", "std_return", "ci95", "returns"}
    looks = {"references", "decision_times", "simulated_episodes", "warnings", "command"}
    legality = {"steps", "unplayable_steps", "unmet_preconditions"}
    assert set(summary) == set(expected) | measured | returns | looks | legality | {"last_iterate"}
    assert set(summary["last_iterate"]) == returns | legality | {
        "episode_lengths",
        "illegal_actions",
        "fallback_actions",
    }
    assert summary["train_seconds"] > 0.0
    assert summary["compile_seconds"] > 0.0


def test_the_summary_names_the_versions_that_are_installed(finished: Run) -> None:
    versions = finished.summary["versions"]
    assert versions["python"] == sys.version.split()[0]
    assert versions["numpy"] == np.__version__
    assert set(versions) == {
        "python",
        "mdpo-rddl",
        "pyRDDLGym",
        "pyRDDLGym-jax",
        "rddlrepository",
        "safetensors",
        "scipy",
        "jax",
        "jaxlib",
        "optax",
        "numpy",
    }


@pytest.mark.parametrize("last", [False, True])
def test_the_statistics_follow_from_the_returns(finished: Run, last: bool) -> None:
    figures = finished.summary["last_iterate"] if last else finished.summary
    returns = figures["returns"]
    assert len(set(returns)) == 3
    mean, deviation = statistics.fmean(returns), statistics.stdev(returns)
    # Student's quantile in closed form, for 2 degrees of freedom
    quantile = 0.95 * (2.0 / (4.0 * 0.975 * 0.025)) ** 0.5
    half = quantile * deviation / 3**0.5
    assert figures["mean_return"] == pytest.approx(mean, rel=1e-12)
    assert figures["std_return"] == pytest.approx(deviation, rel=1e-12)
    # older releases of SciPy have eleven digits of the quantile
    assert figures["ci95"] == pytest.approx([mean - half, mean + half], rel=1e-10)


def test_the_history_and_the_noise_belong_together(finished: Run) -> None:
    records = history(finished.folder)
    sigma = np.load(finished.folder / "noise.npy", allow_pickle=False)
    assert list(records) == ["iteration", "train_return", "test_return", "mean_sigma"]
    assert records["iteration"] == list(range(30))
    assert sigma.shape == (30, 7)
    assert records["mean_sigma"] == pytest.approx(np.mean(sigma, axis=1).tolist(), rel=1e-6)
    assert np.all((sigma >= 0.0) & (sigma <= 10.0))
    assert np.all(sigma.max(axis=1) == 10.0)
    best = int(np.argmax(records["test_return"]))
    assert finished.summary["best_iteration"] == best


@pytest.mark.parametrize("name", ["learning_curve.png", "noise.png"])
def test_the_pictures_show_something(finished: Run, name: str) -> None:
    path = finished.folder / name
    assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    image = matplotlib.image.imread(path)[..., :3]
    height, width, _ = image.shape
    assert height > 400
    assert width > 800
    assert np.mean(np.any(image < 0.9, axis=2)) > 0.01
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 50


def test_the_configuration_is_the_preset_with_the_options(finished: Run) -> None:
    written = json.loads((finished.folder / "config.json").read_text())
    preset = PRESETS["paper"]("tanks").with_values("Optimize", epochs=30)
    assert written == {"source": "paper", "sections": preset.sections, "seed": 0, "episodes": 3}


def test_the_policy_file_holds_what_rebuilds_the_planner(finished: Run) -> None:
    saved = load_policy(finished.folder / "policy.safetensors")
    preset = PRESETS["paper"]("tanks").with_values("Optimize", epochs=30)
    assert PlannerConfig.from_text(saved.config).sections == preset.sections
    problem = load_problem(str(finished.cwd / "tanks.rddl"), str(finished.cwd / "two.rddl"))
    assert saved.problem == {
        "domain": "tanks",
        "instance": "two",
        "label": "two",
        "horizon": 7,
        "digest": problem.digest,
    }
    assert saved.seed == 0


def test_the_same_seed_gives_the_same_run_and_quiet_json_exactly_one_line(
    finished: Run, tmp_path: Path
) -> None:
    write_problem(tmp_path)
    outcome = in_a_process(f"{OPTIONS} --out again --quiet --json", tmp_path)
    assert outcome.err == ""
    assert len(outcome.out.splitlines()) == 1
    unequal = {"train_seconds", "compile_seconds", "decision_times", "command", "references"}
    unequal.add("simulated_episodes")  # as many as fit into the time
    ours = {key: value for key, value in outcome.summary.items() if key not in unequal}
    theirs = {key: value for key, value in finished.summary.items() if key not in unequal}
    assert ours == theirs
    ours, theirs = contents(tmp_path / "again"), contents(finished.folder)
    for name in ("history.csv", "noise.npy", "config.json", "policy.safetensors"):
        assert ours[name] == theirs[name], name


def test_the_commands_begin_without_what_takes_long_to_import() -> None:
    code = "import sys, mdpo_rddl.cli.planning; print({'jax', 'scipy'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
