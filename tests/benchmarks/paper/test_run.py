"""The paper's evaluation at a size for tests: run, stopped, resumed, reported."""

import importlib.util
import json
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from helpers.problems import tiny_files

from benchmarks import main as bench
from benchmarks.commands import paper as bench_paper
from benchmarks.paper import exact, gradient, runner
from benchmarks.paper.cells import PaperSize, load_policies, load_trained
from benchmarks.paper.methods import method_config
from benchmarks.paper.names import METHODS, PPO
from benchmarks.paper.report import load_measured, write_report
from benchmarks.paper.runner import run_paper
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.executors import make_executor
from mdpo_rddl.planner.start import initial_parameters
from mdpo_rddl.problem.load import load_problem

pytestmark = pytest.mark.long

SETTING = "powergen7"
SIZE: dict[str, Any] = {"seeds": 2, "iterations": 7, "rollouts": 3, "episodes": 2}
# constant-3 is constant-1 with another number
TRIED = [method for method in METHODS if method != "constant-3"]
if importlib.util.find_spec("rejax") is None:  # the extra "paper"; test_paper_ppo says so
    TRIED.remove(PPO)


class Interrupted:
    """An executor in which someone presses Ctrl-C after some tasks."""

    def __init__(self, tasks: int) -> None:
        self.tasks = tasks

    def run(self, work: Callable[[Any], None], tasks: Sequence[Any]) -> None:
        make_executor("local", {}).run(work, tasks[: self.tasks])
        raise KeyboardInterrupt


@pytest.fixture(scope="module", autouse=True)
def toy(tmp_path_factory) -> Iterator[None]:
    """A problem that compiles fast goes by the name of a setting; planners are compiled once."""
    problem = load_problem(*tiny_files(tmp_path_factory.mktemp("tiny"), spread=0.1))

    def once(build: Callable[..., Any]) -> Callable[..., Any]:
        built: dict[str, Any] = {}

        def build_once(problem: Any, config: Any, **arguments: Any) -> Any:
            text = config.to_text()
            if text not in built:
                built[text] = build(problem, config, **arguments)
            return built[text]

        return build_once

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(exact, "load_setting", lambda name: problem)
        patch.setattr(gradient, "build_planner", once(gradient.build_planner))
        patch.setattr(gradient, "build_baseline", once(gradient.build_baseline))
        exact.problem_of.cache_clear()
        exact.exact_problem.cache_clear()
        yield
    exact.problem_of.cache_clear()
    exact.exact_problem.cache_clear()


def run(out: Path, methods: Sequence[str] = TRIED, executor: Any = None, **size: Any) -> None:
    executor = executor or make_executor("local", {})
    run_paper(out, [SETTING], methods, PaperSize(**{**SIZE, **size}), executor)


@pytest.fixture(scope="module")
def measured(toy, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("paper")
    run(out)
    return out


def assert_same_results(one: Path, other: Path) -> None:
    """All but times are the same."""
    ours, theirs = load_measured(one), load_measured(other)
    assert list(ours) == list(theirs)
    for key, cell in ours.items():
        np.testing.assert_array_equal(cell.trained.returns, theirs[key].trained.returns)
        np.testing.assert_array_equal(cell.trained.last_returns, theirs[key].trained.last_returns)
        np.testing.assert_array_equal(cell.played, theirs[key].played)


def test_every_method_has_its_curve_its_last_iterates_and_its_episodes(measured):
    cells = load_measured(measured)
    assert list(cells) == [(SETTING, method) for method in TRIED]
    for (_, method), cell in cells.items():
        assert cell.trained.iterations == [1, 2, 3, 4, 5, 6, 7]
        assert cell.trained.returns.shape == (2, 7)
        assert cell.trained.last_returns.shape == (2, 3)
        assert cell.played.shape == (2, 2)
        assert (cell.trained.sigma is not None) == (method == "adaptive")
        np.testing.assert_allclose(cell.scores, cell.trained.returns[:, -5:].mean(axis=1))
    # every method and seed learnt something of its own
    last = np.concatenate([cell.trained.returns[:, -1] for cell in cells.values()])
    same = {key: cells[SETTING, key].trained.returns for key in ("deterministic", "jaxplan")}
    np.testing.assert_allclose(*same.values(), rtol=1e-5)  # without noise ours is JaxPlan
    assert len(set(last.round(3))) == len(last) - 2


def test_all_methods_begin_with_the_weights_of_the_seed(measured):
    """Without a step there is nothing that could tell the methods apart."""
    config = method_config("tiny", "jaxplan", 2)
    still = config.section("Planner")["optimizer_kwargs"] | {"learning_rate": 0.0}
    config = config.with_values("Planner", optimizer_kwargs=still)
    problem, key = exact.problem_of(SETTING), jax.random.PRNGKey(0)
    (jaxplan,) = gradient.train_by_gradient(problem, "jaxplan", config, key, [1])
    planner = gradient.build_planner(problem, method_config("tiny", "adaptive", 2)).planner
    ours = initial_parameters(planner, key)  # PPO starts from these too
    jax.tree.map(np.testing.assert_array_equal, ours, jaxplan.params)
    assert any(np.any(leaf[0] != leaf[1]) for leaf in jax.tree.leaves(ours))  # but not the seeds


@pytest.mark.parametrize(
    ("method", "tolerance"),
    [
        ("adaptive", 1e-5),
        pytest.param("jaxplan", 1e-5, marks=pytest.mark.slow),
        pytest.param(PPO, 1e-4, marks=pytest.mark.slow),
    ],
)
def test_a_seed_does_not_depend_on_how_many_there_are(measured, tmp_path, method, tolerance):
    run(tmp_path, [method], seeds=3)
    two = load_measured(measured)[SETTING, method].trained.returns
    three = load_measured(tmp_path)[SETTING, method].trained.returns
    np.testing.assert_allclose(three[:2], two, rtol=tolerance)
    assert len(set(three[:, -1].round(3))) == 3


def test_what_is_complete_is_not_done_again(measured, monkeypatch):
    def nothing_to_do(*_: Any, **__: Any) -> None:
        raise AssertionError("there is nothing left to do")

    monkeypatch.setattr(runner, "run_cell", nothing_to_do)
    run(measured)


def test_a_run_stopped_between_cells_goes_on(measured, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, TRIED[1:3], Interrupted(1))
    assert len(load_measured(tmp_path)) == 1
    run(tmp_path, TRIED[1:3])
    for method in TRIED[3:] + TRIED[:1]:
        cell = f"cells/{SETTING}_{method}"
        shutil.copytree(measured / cell, tmp_path / cell)
    assert_same_results(tmp_path, measured)


def test_a_run_stopped_while_it_plays_goes_on(measured, tmp_path, monkeypatch):
    shutil.copytree(measured, tmp_path, dirs_exist_ok=True)
    played = tmp_path / f"cells/{SETTING}_adaptive/played.csv"
    whole = played.read_text().splitlines(keepends=True)
    played.write_text("".join(whole[:2]))
    assert (SETTING, "adaptive") not in load_measured(tmp_path)
    monkeypatch.setattr(runner, "_train", lambda cell: pytest.fail("it has been trained"))
    run(tmp_path)
    assert_same_results(tmp_path, measured)
    assert played.read_text().splitlines()[1] == whole[1].strip()


def test_more_seeds_are_played_anew_with_the_policies_they_belong_to(measured, tmp_path):
    run(tmp_path, ["deterministic"], seeds=1)
    run(tmp_path, ["deterministic"])
    folder = tmp_path / f"cells/{SETTING}_deterministic"
    assert load_trained(folder).seeds == len(jax.tree.leaves(load_policies(folder))[0]) == 2
    played = [load_measured(out)[SETTING, "deterministic"].played for out in (tmp_path, measured)]
    np.testing.assert_array_equal(*played)


def test_the_compiled_model_and_the_environment_agree(tmp_path):
    run(tmp_path, ["constant-1"], rollouts=200, episodes=50)
    (cell,) = json.loads(_reported(tmp_path)["table.json"])["cells"]
    assert cell["agree"]
    assert cell["compiled"] == pytest.approx(cell["numpy"], rel=0.05)
    assert cell["compiled_ci95"][0] < cell["compiled"] < cell["compiled_ci95"][1]


def _reported(out: Path) -> dict[str, str]:
    write_report(out)
    return {name: (out / name).read_text() for name in ("table.md", "table.json", "runs.csv")}


def test_the_report_needs_nothing_but_the_files(measured, tmp_path, monkeypatch, capsys):
    shutil.copytree(measured, tmp_path / "there")
    shutil.copytree(measured, tmp_path / "here")
    written = _reported(tmp_path / "there")
    monkeypatch.setattr(exact, "build_planner", lambda *_, **__: pytest.fail("a planner"))
    assert bench.main(["report", str(tmp_path / "here")]) == 0
    assert capsys.readouterr().out == written["table.md"]
    for name, text in written.items():
        assert (tmp_path / "here" / name).read_text() == text
    pictures = {path.name for path in (tmp_path / "here").glob("*.png")}
    assert pictures == {"figure2_iterations.png", "figure2_seconds.png", "figure3.png"}
    lines = written["runs.csv"].splitlines()
    assert len(lines) == 1 + 2 * len(TRIED)
    assert lines[0] == "setting,method,seed,last_5,last_compiled,last_numpy"


def test_bench_runs_and_reports(measured, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bench_paper, "run_landscape", lambda out: None)
    size = [word for name, value in SIZE.items() for word in (f"--{name}", str(value))]
    arguments = ["--settings", SETTING, "--methods", "constant-1", "--out", str(tmp_path), *size]
    assert bench.main(["paper", *arguments]) == 0
    assert capsys.readouterr().out == (tmp_path / "table.md").read_text()
    cells = [load_measured(out)[SETTING, "constant-1"] for out in (tmp_path, measured)]
    np.testing.assert_array_equal(cells[0].trained.returns, cells[1].trained.returns)
    np.testing.assert_array_equal(cells[0].played, cells[1].played)


# --- bad input -----------------------------------------------------------------------------


def test_other_conditions_are_refused_and_nothing_is_lost(measured, tmp_path):
    shutil.copytree(measured, tmp_path, dirs_exist_ok=True)
    with pytest.raises(InputError, match="made with another iterations; use another --out"):
        run(tmp_path, iterations=8)
    assert_same_results(tmp_path, measured)


@pytest.mark.parametrize("text", ["{", "[]", '{"conditions": {}}', '{"returns": 3}'])
def test_a_file_that_is_no_training_is_named(measured, tmp_path, text, capsys):
    shutil.copytree(measured, tmp_path, dirs_exist_ok=True)
    path = tmp_path / f"cells/{SETTING}_jaxplan/training.json"
    path.write_text(text)
    assert bench.main(["report", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"benchmarks: error: {path}: is not a training of the paper")


def test_a_folder_without_results_is_named(tmp_path, capsys):
    assert bench.main(["report", str(tmp_path)]) == 2
    complaint = f"benchmarks: error: {tmp_path}: holds no results of python -m benchmarks paper\n"
    assert capsys.readouterr().err == complaint


def test_a_machine_without_rejax_is_told_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rejax", None)
    monkeypatch.delitem(sys.modules, "benchmarks.paper.ppo_learner", raising=False)
    with pytest.raises(
        InputError, match=r"ppo cannot be imported: .*rejax.*; to get it: pip install"
    ):
        run(tmp_path, [PPO])
