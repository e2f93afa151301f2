"""`mdpo-plan` from the outside: what it prints, what it leaves behind, what it refuses."""

import csv
import json
import re
import shutil
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.image
import numpy as np
import pytest

from mdpo_rddl.cli import plan as command
from mdpo_rddl.cli.display import ProgressBar
from mdpo_rddl.jaxplan.config import PlannerConfig
from mdpo_rddl.noise import ConstantNoise
from mdpo_rddl.planning import build_planner, playable
from mdpo_rddl.presets import PRESETS
from mdpo_rddl.problem import load_problem
from mdpo_rddl.report.policy_file import load_policy
from mdpo_rddl.training import Progress

DOMAIN = """\
domain tanks {
    types { tank : object; };
    pvariables {
        LEVEL(tank) : { non-fluent, real, default = 10.0 };
        volume(tank) : { state-fluent, real, default = 5.0 };
        fill(tank) : { action-fluent, real, default = 0.0 };
    };
    cpfs {
        volume'(?t) = volume(?t) + fill(?t) - Uniform(0.0, 1.0);
    };
    reward = sum_{?t : tank} [-abs[volume(?t) - LEVEL(?t)]];
    action-preconditions {
        forall_{?t : tank} [fill(?t) >= 0.0];
        forall_{?t : tank} [fill(?t) <= 3.0];
    };
}
"""
INSTANCE = """\
non-fluents nf_two {
    domain = tanks;
    objects { tank : {t1, t2}; };
    non-fluents { LEVEL(t2) = 8.0; };
}
instance two {
    domain = tanks;
    non-fluents = nf_two;
    init-state { volume(t1) = 2.0; };
    max-nondef-actions = pos-inf;
    horizon = 7;
    discount = 1.0;
}
"""
CONFIG = """\
[Compiler]
sigmoid_weight=10

[Planner]
method='JaxStraightLinePlan'
optimizer='rmsprop'
optimizer_kwargs={'learning_rate': 0.1}
batch_size_train=2
batch_size_test=2
rollout_horizon=3
pgpe=None

[Optimize]
key=5
epochs=4
train_seconds=60
print_summary=True

[Noise]
method='ConstantNoise'
sigma=0.5
"""
TANKS = "tanks.rddl two.rddl"
RUN_FILES = {
    "summary.json",
    "policy.safetensors",
    "config.json",
    "history.csv",
    "noise.npy",
    "learning_curve.png",
    "noise.png",
}


class Outcome(NamedTuple):
    """What a command came to."""

    status: int
    out: str
    err: str

    @property
    def summary(self) -> dict[str, Any]:
        assert self.status == 0, self.err
        return json.loads(self.out.splitlines()[-1])


def write_problem(folder: Path) -> None:
    (folder / "tanks.rddl").write_text(DOMAIN)
    (folder / "two.rddl").write_text(INSTANCE)


def changed(text: str, old: str, new: str) -> str:
    assert text.count(old) == 1
    return text.replace(old, new)


def in_a_process(arguments: str, folder: Path) -> Outcome:
    """Runs the command as a user does."""
    done = subprocess.run(
        [sys.executable, "-m", "mdpo_rddl.cli.plan", *arguments.split()],
        cwd=folder,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=120,
        check=False,
    )
    return Outcome(done.returncode, done.stdout, done.stderr)


def run(arguments: str, capsys: pytest.CaptureFixture[str]) -> Outcome:
    """Runs the command in this process and the current folder."""
    capsys.readouterr()
    try:
        status = command.main(arguments.split())
    except SystemExit as end:
        status = end.code
    return Outcome(status, *capsys.readouterr())


def contents(folder: Path) -> dict[str, bytes | None]:
    """Every path under a folder, hidden ones too, with a file's bytes or None for a folder."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def history(folder: Path) -> dict[str, list[float]]:
    with (folder / "history.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: [float(row[name]) for row in rows] for name in rows[0]}


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with a problem in it."""
    write_problem(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


class Run(NamedTuple):
    """A finished run: where it was started, its folder, and what the command printed."""

    cwd: Path
    folder: Path
    outcome: Outcome

    @property
    def summary(self) -> dict[str, Any]:
        return json.loads((self.folder / "summary.json").read_text())


OPTIONS = f"{TANKS} --iterations 30 --episodes 3"


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """One real run, which many tests look at and none changes."""
    cwd = tmp_path_factory.mktemp("finished")
    write_problem(cwd)
    return Run(cwd, cwd / "run", in_a_process(f"{OPTIONS} --out run --json", cwd))


# one run, from all sides


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
    stages = [line.split()[0] for line in finished.outcome.err.splitlines() if line.strip()]
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
    assert set(summary) == set(expected) | measured | returns | {"last_iterate"}
    assert set(summary["last_iterate"]) == returns | {
        "episode_lengths",
        "illegal_actions",
        "fallback_actions",
    }
    assert 0.0 < summary["train_seconds"] < 60.0
    assert 0.0 < summary["compile_seconds"] < 120.0


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
    assert figures["ci95"] == pytest.approx([mean - half, mean + half], rel=1e-12)


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


# a saved policy


def test_a_loaded_policy_earns_the_same_to_the_last_digit(
    finished: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(finished.cwd)
    before = contents(finished.cwd)
    loaded = run(f"{TANKS} --load run --episodes 3 --json", capsys).summary
    figures = ["mean_return", "std_return", "ci95", "returns", "episode_lengths", "illegal_actions"]
    assert {key: loaded[key] for key in figures} == {key: finished.summary[key] for key in figures}
    identity = ["domain", "instance", "horizon", "noise", "noise_parameters", "policy", "seed"]
    assert {key: loaded[key] for key in identity} == {
        key: finished.summary[key] for key in identity
    }
    assert loaded["loaded_from"] == "run"
    assert contents(finished.cwd) == before


def test_a_loaded_policy_with_other_seeds_and_episodes(
    finished: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(finished.cwd)
    fewer = run(f"{TANKS} --load run --episodes 2 --quiet --json", capsys).summary
    assert fewer["returns"] == finished.summary["returns"][:2]
    one = run(f"{TANKS} --load run --episodes 1 --quiet --json", capsys).summary
    assert (one["returns"], one["ci95"], one["std_return"]) == (fewer["returns"][:1], None, 0.0)
    other = run(f"{TANKS} --load run --episodes 2 --seed 1 --quiet --json", capsys).summary
    assert other["seed"] == 1
    assert not set(other["returns"]) & set(fewer["returns"])


def test_a_loaded_policy_plays_another_horizon_where_it_can(
    finished: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(finished.cwd)
    loaded = run(f"{TANKS} --load run --episodes 2 --horizon 4 --quiet --json", capsys).summary
    assert (loaded["horizon"], loaded["episode_lengths"]) == (4, [4, 4])
    with_rest = np.array(finished.summary["returns"][:2])
    assert np.all(np.array(loaded["returns"]) > with_rest)  # each step costs


def test_the_evaluation_of_a_loaded_policy_can_be_kept(
    finished: Run, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    outcome = run(f"{TANKS} --load {finished.folder} --episodes 2 --json --out kept/it", capsys)
    assert "written to kept/it" in outcome.out
    assert {path.name for path in (workplace / "kept" / "it").iterdir()} == {"summary.json"}
    assert json.loads((workplace / "kept/it/summary.json").read_text()) == outcome.summary


def test_quiet_prints_nothing(
    finished: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(finished.cwd)
    assert run(f"{TANKS} --load run --episodes 1 --quiet", capsys) == Outcome(0, "", "")


def refuse(
    arguments: str, said: str, folder: Path, capsys: pytest.CaptureFixture[str], start: bool = False
) -> None:
    """The command ends with status 2 and one line, and changes nothing in the folder."""
    before = contents(folder)
    outcome = run(arguments, capsys)
    assert outcome.status == 2
    assert outcome.out == ""
    lines = outcome.err.splitlines()
    assert len(lines) == 1, outcome.err
    if start:
        assert lines[0].startswith(f"mdpo-plan: error: {said}")
    else:
        assert lines[0] == f"mdpo-plan: error: {said}"
    assert contents(folder) == before


def damage(path: Path, change: str) -> None:
    data = path.read_bytes()
    match change:
        case "truncated":
            path.write_bytes(data[: len(data) // 2])
        case "changed":
            path.write_bytes(data[:-2] + bytes([data[-2] ^ 1]) + data[-1:])
        case "empty":
            path.write_bytes(b"")
        case "gone":
            path.unlink()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("truncated", "damaged policy file: Error while deserializing header: "),
        ("changed", "damaged policy file: its contents do not match their digest"),
        ("empty", "damaged policy file: Error while deserializing header: header too small"),
        ("gone", "no such policy"),
    ],
)
def test_a_damaged_run_folder(
    change: str,
    said: str,
    finished: Run,
    workplace: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shutil.copytree(finished.folder, "run")
    damage(Path("run/policy.safetensors"), change)
    said = f"run/policy.safetensors: {said}"
    refuse(f"{TANKS} --load run --out new", said, workplace, capsys, start=True)


def test_a_policy_of_another_problem(
    finished: Run, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    policy = finished.folder / "policy.safetensors"
    of = f"{policy}: saved for two (tanks/two), not for"
    load = f"--load {finished.folder}"
    said = f"{of} Reservoir_ippc2023-1 (reservoir_control_cont/inst_reservoir_control_cont_1c) "
    refuse(f"Reservoir_ippc2023 1 {load}", said, workplace, capsys, start=True)
    # the same names, but no longer the same problem
    (workplace / "two.rddl").write_text(INSTANCE.replace("LEVEL(t2) = 8.0", "LEVEL(t2) = 9.0"))
    said = f"{of} two (tanks/two) as its files are now"
    refuse(f"{TANKS} {load}", said, workplace, capsys)


def test_the_run_that_is_loaded_is_not_overwritten(
    finished: Run, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(finished.folder, "run")
    said = "run/../run: not overwritten: the policy is loaded from it"
    refuse(f"{TANKS} --load run --out run/../run", said, workplace, capsys)


def test_an_evaluation_alone_cannot_be_loaded(
    finished: Run, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(f"{TANKS} --load {finished.folder} --episodes 1 --quiet --out kept", capsys)
    said = "kept/policy.safetensors: no such policy"
    refuse(f"{TANKS} --load kept", said, workplace, capsys)


# other runs


def test_the_same_seed_gives_the_same_run_and_quiet_json_exactly_one_line(
    finished: Run, tmp_path: Path
) -> None:
    write_problem(tmp_path)
    outcome = in_a_process(f"{OPTIONS} --out again --quiet --json", tmp_path)
    assert outcome.err == ""
    assert len(outcome.out.splitlines()) == 1
    unequal = {"train_seconds", "compile_seconds"}
    ours = {key: value for key, value in outcome.summary.items() if key not in unequal}
    theirs = {key: value for key, value in finished.summary.items() if key not in unequal}
    assert ours == theirs
    ours, theirs = contents(tmp_path / "again"), contents(finished.folder)
    for name in ("history.csv", "noise.npy", "config.json"):
        assert ours[name] == theirs[name]
    mine, yours = (
        load_policy(folder / "policy.safetensors")
        for folder in (tmp_path / "again", finished.folder)
    )
    for layer, tensors in yours.params["params"].items():
        for name, tensor in tensors.items():
            np.testing.assert_array_equal(mine.params["params"][layer][name], tensor, strict=True)


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
    assert [layer["bias"].shape for layer in one_policy.values()][:2] == [(12,), (12,)]
    loaded = run(f"{TANKS} --load run --episodes 3 --quiet --json", capsys).summary
    assert loaded["returns"] == summary["returns"]


def test_the_seconds_bound_the_training(
    workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = "--iterations 1000000000 --seconds 1 --episodes 1 --quiet --json"
    summary = run(f"{TANKS} {options}", capsys).summary
    assert summary["status"] == "time_budget_reached"
    assert 1.0 <= summary["train_seconds"] < 3.0
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
    assert PlannerConfig.from_text(saved.config).noise() == ConstantNoise(sigma=0.5)

    # three steps of a plan for seven
    said = "the plan has 3 steps, its last action is repeated up to the horizon 7"
    assert [record.getMessage() for record in caplog.records] == [said]
    problem = load_problem("tanks.rddl", "two.rddl")
    planner, _ = build_planner(problem, PlannerConfig.from_text(saved.config))
    policy = playable(planner, saved.params, saved.policy_hyperparams, saved.seed)
    state = {"volume": np.array([5.0, 5.0])}
    actions = [policy(step, state)["fill"] for step in range(7)]
    np.testing.assert_array_equal(actions[:3], np.clip(saved.params["fill"], 0.0, 3.0))
    np.testing.assert_array_equal(actions[3:], [actions[2]] * 4)


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


def test_an_interrupt_keeps_what_was_found(
    workplace: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(bar: ProgressBar, progress: Progress) -> None:
        if progress.iteration == 5:
            raise KeyboardInterrupt

    monkeypatch.setattr(ProgressBar, "training", interrupt)
    summary = run(f"{OPTIONS} --out run --quiet --json", capsys).summary
    assert (summary["status"], summary["iterations"]) == ("interrupted", 6)
    assert {path.name for path in (workplace / "run").iterdir()} == RUN_FILES


def test_an_interrupt_before_that_leaves_nothing(
    workplace: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(bar: ProgressBar, name: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(ProgressBar, "stage", interrupt)
    before = contents(workplace)
    outcome = run(f"{OPTIONS} --json", capsys)
    assert outcome == Outcome(130, "", "mdpo-plan: interrupted, nothing was written\n")
    assert contents(workplace) == before


# bad input


BAD_FILES = {
    "broken.rddl": changed(DOMAIN, "- Uniform", "- - ) Uniform"),
    "unfinished.rddl": changed(INSTANCE, "horizon = 7;", "horizon = 7"),
    "undefined.rddl": changed(DOMAIN, "+ fill(?t)", "+ fil(?t)"),
    "lakes.rddl": INSTANCE.replace("domain = tanks", "domain = lakes"),
    "endless.rddl": changed(INSTANCE, "    horizon = 7;\n", ""),
    "key.cfg": changed(CONFIG, "epochs=4", "epoch=4"),
    "quote.cfg": changed(CONFIG, "'rmsprop'", "'rmsprop"),
    "sigma.cfg": changed(CONFIG, "sigma=0.5", "sigma=-1"),
    "latin.cfg": CONFIG,
    "width.cfg": changed(
        CONFIG, "'JaxStraightLinePlan'", "'JaxDeepReactivePolicy'\nmethod_kwargs={'topology': 'a'}"
    ),
    "rate.cfg": changed(CONFIG, "'learning_rate'", "'learning_speed'"),
    "file": "x",
    "thesis/chapter.tex": "x",
}


@pytest.fixture
def bad_workplace(workplace: Path) -> Path:
    """The current folder, with a problem and all sorts of mistakes in it."""
    (workplace / "thesis").mkdir()
    for name, text in BAD_FILES.items():
        (workplace / name).write_text(text)
    (workplace / "latin.cfg").write_bytes(b"# \xe9\n" + CONFIG.encode())
    return workplace


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("no.rddl two.rddl", "no.rddl: cannot read the domain file: No such file or directory"),
        ("tanks.rddl no/no", "no/no: cannot read the instance file: No such file or directory"),
        ("thesis/ two.rddl", "thesis: cannot read the domain file: Is a directory"),
        ("broken.rddl two.rddl", "broken.rddl:9: syntax error at ')'"),
        (
            "tanks.rddl unfinished.rddl",
            "unfinished.rddl:12: syntax error at the keyword 'discount' (or at the end of line 11)",
        ),
        ("two.rddl tanks.rddl", "two.rddl: the domain file has no domain block but an instance"),
        ("undefined.rddl two.rddl", "undefined.rddl, two.rddl: Variable <fil> is not defined"),
        ("tanks.rddl endless.rddl", "endless.rddl: instance 'two' has no horizon"),
        (
            "tanks.rddl lakes.rddl",
            "lakes.rddl: instance 'two' is for domain 'lakes', but tanks.rddl defines 'tanks'",
        ),
        ("Resevoir 1", "'Resevoir' is neither a file nor a problem of rddlrepository"),
        (
            "Reservoir_ippc2023 99",
            "'99' is neither a file nor an instance of the rddlrepository problem "
            "'Reservoir_ippc2023', which has: 1 2 3 4 5",
        ),
        (f"{TANKS} --sigma 1", "--sigma needs --noise constant"),
        (f"{TANKS} --noise none --alpha 1", "--alpha needs --noise adaptive"),
        (
            f"{TANKS} --sigma-min 11",
            "--sigma-min 11 is above sigma_max, 10: set --sigma-max",
        ),
        (f"{TANKS} --config no.cfg", "no.cfg: cannot read the configuration: No such file or"),
        (f"{TANKS} --config latin.cfg", "latin.cfg: cannot read the configuration: not a UTF-8"),
        (f"{TANKS} --config key.cfg", "key.cfg: [Optimize] unknown key 'epoch', known are "),
        (f"{TANKS} --config quote.cfg", 'quote.cfg:6: [Planner] optimizer: "\'rmsprop" is not a'),
        (f"{TANKS} --config sigma.cfg", "sigma.cfg: [Noise] sigma must be at least 0, got -1"),
        (f"{TANKS} --config two.rddl", "two.rddl:1: no section header, such as [Planner], comes"),
        (f"{TANKS} --config rate.cfg", "two.rddl: JaxPlan cannot compile it: "),
        (f"{TANKS} --config width.cfg", "two.rddl: JaxPlan cannot compile the planner: "),
        (f"{TANKS} --out file", "file: cannot write the run there: it is a file"),
        (f"{TANKS} --out file/run", "file/run: cannot write the run there: File exists"),
        (f"{TANKS} --out thesis", "thesis: not overwritten: it is not empty and holds no run"),
        (f"{TANKS} --out .", ".: cannot write the run there: name a folder inside it"),
        (f"{TANKS} --load no", "no: no such run folder"),
        (f"{TANKS} --load file", "file: no such run folder"),
        (f"{TANKS} --load thesis", "thesis/policy.safetensors: no such policy"),
        (f"{TANKS} --load no --iterations 3", "--iterations does not go with --load, which train"),
        (f"{TANKS} --load no --sigma-max 3", "--sigma-max does not go with --load, which trains"),
    ],
)
def test_bad_input_ends_with_one_line_and_leaves_nothing(
    arguments: str, said: str, bad_workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refuse(f"{arguments} --json", said, bad_workplace, capsys, start=True)


def test_what_jaxplan_cannot_compile_names_the_configuration_too(
    bad_workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    outcome = run(f"{TANKS} --config rate.cfg", capsys)
    assert "'learning_speed'" in outcome.err
    assert outcome.err.endswith(" (configured by rate.cfg)\n")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--iteration-count 3", "unrecognized arguments: --iteration-count 3"),
        ("--noise loud", "argument --noise: invalid choice: 'loud'"),
        ("--policy net", "argument --policy: invalid choice: 'net'"),
        ("--preset mine", "argument --preset: invalid choice: 'mine'"),
        ("--sigma -1", "argument --sigma: must be a number at least 0, got '-1'"),
        ("--sigma-min -0.1", "argument --sigma-min: must be a number at least 0, got '-0.1'"),
        ("--sigma-max inf", "argument --sigma-max: must be a number at least 0, got 'inf'"),
        ("--alpha 0", "argument --alpha: must be a number above 0, got '0'"),
        ("--alpha nan", "argument --alpha: must be a number above 0, got 'nan'"),
        ("--quantile 0", "argument --quantile: must be a number above 0 and at most 1, got '0'"),
        ("--quantile 1.1", "argument --quantile: must be a number above 0 and at most 1, got "),
        ("--weight 0", "argument --weight: must be a number above 0, got '0'"),
        ("--weight ten", "argument --weight: must be a number above 0, got 'ten'"),
        ("--seconds 0", "argument --seconds: must be a number above 0, got '0'"),
        ("--iterations 0", "argument --iterations: must be a positive integer, got '0'"),
        ("--iterations 1e3", "argument --iterations: must be a positive integer, got '1e3'"),
        ("--restarts 0", "argument --restarts: must be a positive integer, got '0'"),
        ("--batch -2", "argument --batch: must be a positive integer, got '-2'"),
        ("--horizon 0", "argument --horizon: must be a positive integer, got '0'"),
        ("--episodes \u00b2", "argument --episodes: must be a positive integer, got '\u00b2'"),
        ("--seed -1", "argument --seed: must be an integer from 0 to 2147483647, got '-1'"),
        ("--seed 2147483648", "argument --seed: must be an integer from 0 to 2147483647, got "),
        ("--out", "argument --out: expected one argument"),
        ("--preset paper --config my.cfg", "argument --config: not allowed with argument --preset"),
        ("--load run --config my.cfg", "argument --config: not allowed with argument --load"),
    ],
)
def test_a_bad_option_ends_with_one_line(
    options: str, said: str, workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refuse(f"{TANKS} {options}", said, workplace, capsys, start=True)


def test_arguments_with_line_breaks_still_make_one_line(
    workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command.main(["tanks.rddl", "two.rddl", "--out", "two.rddl/a\nb"]) == 2
    with pytest.raises(SystemExit) as end:
        command.main(["tanks.rddl", "two.rddl", "--a\nb"])
    assert end.value.code == 2
    assert capsys.readouterr().err == (
        "mdpo-plan: error: two.rddl/a b: cannot write the run there: File exists\n"
        "mdpo-plan: error: unrecognized arguments: --a b (see mdpo-plan --help)\n"
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("no.rddl two.rddl", "no.rddl: cannot read the domain file: No such file or directory"),
        ("broken.rddl two.rddl", "broken.rddl:9: syntax error at ')'"),
        (f"{TANKS} --sgima 1", "unrecognized arguments: --sgima 1 (see mdpo-plan --help)"),
        (f"{TANKS} --config rate.cfg", "two.rddl: JaxPlan cannot compile it: "),
    ],
)
def test_bad_input_to_the_real_command(arguments: str, said: str, bad_workplace: Path) -> None:
    before = contents(bad_workplace)
    status, out, err = in_a_process(f"{arguments} --json", bad_workplace)
    assert (status, out) == (2, "")
    assert err.startswith(f"mdpo-plan: error: {said}")
    assert err.count("\n") == 1
    assert contents(bad_workplace) == before
