"""The measurements: rows as they come, stopped and resumed, and what the tables hold."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from problems import ROOT

from mdpo_rddl import training
from mdpo_rddl.cli import bench, plan
from mdpo_rddl.errors import InputError
from mdpo_rddl.experiments import full_training, noise_sweep, paper_preset
from mdpo_rddl.experiments.noise_sweep import sweep, sweep_table
from mdpo_rddl.experiments.paper_preset import paper_preset_table, run_paper_preset
from mdpo_rddl.experiments.records import Records
from mdpo_rddl.experiments.settings import DOMAIN_FILES, load_setting
from mdpo_rddl.planning import build_planner
from mdpo_rddl.session import offline

COLUMNS = ("name", "seed", "value")


def one_line(call: Callable[[], object]) -> str:
    with pytest.raises(InputError) as error:
        call()
    message = str(error.value)
    assert message.isprintable()
    return message


# --- records -------------------------------------------------------------------------------


def test_records_write_each_row_at_once_and_go_on_from_it(tmp_path):
    path = tmp_path / "new" / "folder" / "rows.csv"
    records = Records(path, COLUMNS, COLUMNS[:2])
    assert path.read_text() == "name,seed,value\n"
    records.add("a", 0, 0.1)
    assert path.read_bytes() == b"name,seed,value\na,0,0.1\n"
    records.add("b,c", 1, 1e-300)

    resumed = Records(path, COLUMNS, COLUMNS[:2])
    assert resumed.rows == records.rows
    assert resumed.rows[1] == {"name": "b,c", "seed": "1", "value": "1e-300"}
    assert resumed.has("a", 0)
    assert resumed.has("b,c", 1)
    assert not resumed.has("a", 1)
    assert not resumed.has("b", 1)
    resumed.add("a", 1, 2.0)
    assert path.read_bytes() == b'name,seed,value\na,0,0.1\n"b,c",1,1e-300\na,1,2.0\n'


def test_numbers_survive_the_file_to_the_last_digit(tmp_path):
    value = float(np.nextafter(-1371468.0, 0.0))
    Records(tmp_path / "rows.csv", COLUMNS, COLUMNS[:2]).add("a", 0, value)
    (row,) = Records(tmp_path / "rows.csv", COLUMNS, COLUMNS[:2]).rows
    assert float(row["value"]) == value


def test_a_row_of_the_wrong_length_is_not_written(tmp_path):
    records = Records(tmp_path / "rows.csv", COLUMNS, COLUMNS[:2])
    with pytest.raises(ValueError, match="zip"):
        records.add("a", 0)
    assert records.rows == []
    assert (tmp_path / "rows.csv").read_text() == "name,seed,value\n"


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"name,value\n", "{path}: holds other results (columns name, value)"),
        (b"name,value,seed\n", "{path}: holds other results (columns name, value, seed)"),
        (b"name,seed,value\na,0,1\nb,0\n", "{path}:3: is not a whole row; delete the line"),
        (b"name,seed,value\na,0,1,2\n", "{path}:2: is not a whole row; delete the line"),
        (b"name,seed,value\na,0,1", "{path}:2: the line has no end; delete or end it"),
        (b"\xff\xfe\x00", "{path}: is not a CSV file of results"),
    ],
)
def test_a_file_of_anything_else_is_refused_and_left_alone(tmp_path, content, complaint):
    path = tmp_path / "rows.csv"
    path.write_bytes(content)
    assert one_line(lambda: Records(path, COLUMNS, COLUMNS[:2])) == complaint.format(path=path)
    assert path.read_bytes() == content


def test_rows_with_the_line_ends_of_windows_are_read(tmp_path):
    path = tmp_path / "rows.csv"
    path.write_bytes(b"name,seed,value\na,0,1\r\nb,0,2\r\n")
    assert [row["value"] for row in Records(path, COLUMNS, COLUMNS[:2]).rows] == ["1", "2"]


def test_a_path_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    beneath_a_file = tmp_path / "file" / "rows.csv"
    message = one_line(lambda: Records(beneath_a_file, COLUMNS, COLUMNS[:2]))
    assert message.startswith(f"{beneath_a_file}: cannot be written: ")
    (tmp_path / "rows.csv").mkdir()
    message = one_line(lambda: Records(tmp_path / "rows.csv", COLUMNS, COLUMNS[:2]))
    assert message == f"{tmp_path / 'rows.csv'}: cannot be written: Is a directory"


def test_a_file_that_can_only_be_read_is_refused_before_anything_is_trained(tmp_path, monkeypatch):
    path = tmp_path / "rows.csv"
    path.write_text("name,seed,value\n")
    opened = Path.open

    def read_only(self: Path, mode: str = "r", **kwargs: Any) -> Any:
        if set(mode) & set("wa+"):
            raise PermissionError(13, "Permission denied")
        return opened(self, mode, **kwargs)

    monkeypatch.setattr(Path, "open", read_only)
    message = one_line(lambda: Records(path, COLUMNS, COLUMNS[:2]))
    assert message == f"{path}: cannot be written: Permission denied"


# --- settings ------------------------------------------------------------------------------


def test_every_setting_loads_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert sorted(DOMAIN_FILES) == sorted(paper_preset.PAPER)
    for name in DOMAIN_FILES:
        problem = load_setting(name, ROOT)
        assert (problem.label, problem.horizon) == (name, 120)


def test_an_unknown_setting_names_the_known_ones():
    message = one_line(lambda: load_setting("powergen8", ROOT))
    assert message == f"unknown setting 'powergen8', known are {', '.join(DOMAIN_FILES)}"


def test_a_setting_without_its_files_names_the_missing_one(tmp_path):
    message = one_line(lambda: load_setting("hvac10", tmp_path))
    assert message.startswith(f"{tmp_path / 'domains' / 'hvac.rddl'}: cannot read")


# --- the experiments at toy size -----------------------------------------------------------

TOY_SWEEP = {
    "settings": ["powergen7"],
    "alphas": [0.5, 2.0],
    "sigma_maxes": [10.0],
    "seeds": 2,
    "iterations": 3,
    "episodes": 2,
}
TOY_PAPER = {
    "noises": ["none", "adaptive"],
    "settings": ["powergen7"],
    "seeds": 2,
    "iterations": 3,
    "episodes": 2,
}
TOY_OPTIONS = ["--settings", "powergen7", "--seeds", "2", "--iterations", "3", "--episodes", "2"]


@pytest.fixture(scope="module", autouse=True)
def toy() -> Iterator[None]:
    """The shipped files, and planners that are compiled once for all tests."""
    planners: dict[str, Any] = {}

    def build(problem, config):
        key = problem.label + config.with_section("Optimize", {}).to_text()
        if key not in planners:
            planners[key], _ = build_planner(problem, config)
        return planners[key], config.jaxplan_arguments()[2]

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        for module in (noise_sweep, paper_preset, offline):
            patch.setattr(module, "build_planner", build)
        yield


@pytest.fixture(scope="module")
def swept(toy, tmp_path_factory) -> Records:
    return sweep(tmp_path_factory.mktemp("sweep"), **TOY_SWEEP)


@pytest.fixture(scope="module")
def measured(toy, tmp_path_factory) -> Records:
    return run_paper_preset(tmp_path_factory.mktemp("paper"), **TOY_PAPER)


def without_seconds(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    return [{k: v for k, v in row.items() if k != "train_seconds"} for row in rows]


def refuse(*args: Any, **kwargs: Any) -> None:
    raise AssertionError("there is nothing left to do")


def interrupt_training(monkeypatch, number: int) -> None:
    """Presses Ctrl-C in the first iteration of the given training, counted from 0."""
    begun: list[int] = []

    def train(planner, **kwargs: Any):
        begun.append(len(begun))
        if begun[-1] == number:
            kwargs["on_progress"] = interrupt
        return training.train(planner, **kwargs)

    def interrupt(progress) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(full_training, "train", train)


def test_the_sweep_has_a_row_for_every_combination_and_seed(swept):
    keys = [(row["alpha"], row["sigma_max"], row["restart"]) for row in swept.rows]
    assert keys == [(a, "10.0", s) for a in ("0.5", "2.0") for s in ("0", "1")]
    # every seed and every alpha has a result of its own
    assert len({row["last_return"] for row in swept.rows}) == 4
    assert Records(swept.path, noise_sweep.COLUMNS, noise_sweep.KEYS).rows == swept.rows


def test_the_order_of_the_sweep_does_not_matter(swept, tmp_path):
    # one compiled planner serves all combinations
    backwards = sweep(tmp_path, **TOY_SWEEP | {"alphas": [2.0, 0.5]})
    assert backwards.rows == [*swept.rows[2:], *swept.rows[:2]]


def test_a_sweep_that_is_complete_trains_nothing(swept, monkeypatch):
    written = swept.path.read_bytes()
    monkeypatch.setattr(full_training, "train", refuse)
    monkeypatch.setattr(noise_sweep, "build_planner", refuse)
    again = sweep(swept.path.parent, **TOY_SWEEP)
    assert again.rows == swept.rows
    assert swept.path.read_bytes() == written


def test_a_sweep_stopped_in_a_training_records_nothing_of_it_and_goes_on(
    swept, tmp_path, monkeypatch
):
    with monkeypatch.context() as patch:
        interrupt_training(patch, 1)
        with pytest.raises(KeyboardInterrupt):
            sweep(tmp_path, **TOY_SWEEP)
    stopped = Records(tmp_path / "sweep.csv", noise_sweep.COLUMNS, noise_sweep.KEYS)
    assert stopped.rows == swept.rows[:2]
    assert sweep(tmp_path, **TOY_SWEEP).rows == swept.rows
    assert (tmp_path / "sweep.csv").read_bytes() == swept.path.read_bytes()


def test_a_sweep_stopped_between_two_seeds_goes_on(swept, tmp_path, monkeypatch):
    evaluations: list[int] = []

    def evaluate(env, policy, episodes, seed):
        evaluations.append(seed)
        if len(evaluations) == 2:
            raise KeyboardInterrupt
        return noise_sweep_evaluate(env, policy, episodes, seed)

    noise_sweep_evaluate = noise_sweep.evaluate
    with monkeypatch.context() as patch:
        patch.setattr(noise_sweep, "evaluate", evaluate)
        with pytest.raises(KeyboardInterrupt):
            sweep(tmp_path, **TOY_SWEEP)
    stopped = Records(tmp_path / "sweep.csv", noise_sweep.COLUMNS, noise_sweep.KEYS)
    assert stopped.rows == swept.rows[:1]
    assert evaluations == [0, 1]  # each restart is evaluated with a seed of its own
    assert sweep(tmp_path, **TOY_SWEEP).rows == swept.rows


def test_the_paper_preset_has_a_row_for_each_noise_and_seed(measured):
    keys = [(row["noise"], row["seed"]) for row in measured.rows]
    assert keys == [(n, s) for n in ("none", "adaptive") for s in ("0", "1")]
    assert len({row["last_return"] for row in measured.rows}) == 4
    assert all(float(row["train_seconds"]) >= 0 for row in measured.rows)
    saved = Records(measured.path, paper_preset.COLUMNS, paper_preset.KEYS)
    assert saved.rows == measured.rows


@pytest.mark.parametrize(("noise", "seed"), [("none", "1"), ("adaptive", "0")])
def test_the_paper_preset_measures_what_mdpo_plan_gives(measured, tmp_path, capsys, noise, seed):
    arguments = ["domains/powergen.rddl", "instances/powergen7.rddl", "--preset", "paper"]
    arguments += ["--noise", noise, "--seed", seed, "--iterations", "3", "--episodes", "2"]
    assert plan.main([*arguments, "--out", str(tmp_path / "run"), "--json", "--quiet"]) == 0
    summary = json.loads(capsys.readouterr().out)
    (row,) = (row for row in measured.rows if (row["noise"], row["seed"]) == (noise, seed))
    assert float(row["last_return"]) == summary["last_iterate"]["mean_return"]
    assert float(row["best_return"]) == summary["mean_return"]


def test_a_paper_preset_that_is_complete_trains_nothing(measured, monkeypatch):
    written = measured.path.read_bytes()
    monkeypatch.setattr(full_training, "train", refuse)
    monkeypatch.setattr(paper_preset, "build_planner", refuse)
    again = run_paper_preset(measured.path.parent, **TOY_PAPER)
    assert again.rows == measured.rows
    assert measured.path.read_bytes() == written


@pytest.mark.parametrize("finished", [0, 1, 3])
def test_a_paper_preset_stopped_in_a_training_goes_on(measured, tmp_path, monkeypatch, finished):
    with monkeypatch.context() as patch:
        interrupt_training(patch, finished)
        with pytest.raises(KeyboardInterrupt):
            run_paper_preset(tmp_path, **TOY_PAPER)
    stopped = Records(tmp_path / "runs.csv", paper_preset.COLUMNS, paper_preset.KEYS)
    assert without_seconds(stopped.rows) == without_seconds(measured.rows[:finished])
    resumed = run_paper_preset(tmp_path, **TOY_PAPER)
    assert without_seconds(resumed.rows) == without_seconds(measured.rows)


def test_more_seeds_leave_those_that_are_there(measured, tmp_path):
    one = run_paper_preset(tmp_path, **TOY_PAPER | {"seeds": 1})
    assert without_seconds(one.rows) == without_seconds(measured.rows[0::2])
    two = run_paper_preset(tmp_path, **TOY_PAPER)
    assert two.rows[:2] == one.rows
    assert without_seconds(two.rows[2:]) == without_seconds(measured.rows[1::2])


# --- tables --------------------------------------------------------------------------------


def test_the_sweep_table_worked_by_hand(tmp_path):
    records = Records(tmp_path / "sweep.csv", noise_sweep.COLUMNS, noise_sweep.KEYS)
    for row in [
        ("powergen7", 2.0, 10.0, 0, 1000.0),
        ("powergen7", 2.0, 10.0, 1, 3000.0),  # mean 2000, deviations 1000: sqrt(2e6 / 1)
        ("powergen7", 0.5, 10.0, 0, -7.4),
        ("hvac10", 0.5, 10.0, 0, -1e6),
        ("hvac10", 0.5, 10.0, 1, -2e6),
        ("hvac10", 0.5, 10.0, 2, -3e6),
        ("hvac10", 4.0, 9.0, 0, 0.0),
    ]:
        records.add(*row)
    assert sweep_table(records) == (
        "| sigma_max | alpha | powergen7 | hvac10 |\n"
        "|---|---|---|---|\n"
        "| 9 | 4 |  | 0 ± 0 |\n"
        "| 10 | 0.5 | -7 ± 0 | -2,000,000 ± 1,000,000 |\n"
        "| 10 | 2 | 2,000 ± 1,414 |  |\n"
    )


def test_the_paper_preset_table_worked_by_hand(tmp_path):
    records = Records(tmp_path / "runs.csv", paper_preset.COLUMNS, paper_preset.KEYS)
    for row in [
        ("powergen7", "none", 0, -40000.0, -1.0, 9.0),
        ("powergen7", "none", 1, -30000.0, -1.0, 9.0),
        ("powergen7", "adaptive", 0, 9000.0, 12000.0, 9.0),
        ("powergen7", "adaptive", 1, 11000.0, 14000.0, 9.0),
        ("powergen7", "adaptive", 2, 10000.0, 13000.0, 9.0),
        ("hvac10", "none", 0, -3268060.4, -1.0, 9.0),
        ("hvac10", "adaptive", 0, -1371468.4, -1371467.6, 9.0),
        ("hvac20", "none", 0, -5.0, -1.0, 9.0),  # its other half is still to come
    ]:
        records.add(*row)
    header = "| setting | seeds | none | paper's | adaptive | paper's | adaptive, best iterate |\n"
    assert paper_preset_table(records) == (
        f"{header}|---|---|---|---|---|---|---|\n"
        "| hvac10 | 1 | -3,268,060 ± 0 | -3,268,060 "
        "| -1,371,468 ± 0 | -1,371,468 | -1,371,468 ± 0 |\n"
        "| hvac20 | 1 | -5 ± 0 | -5,799,275 |  | -2,086,876 |  |\n"
        "| powergen7 | 3 | -35,000 ± 7,071 | -38,565 "
        "| 10,000 ± 1,000 | 10,076 | 13,000 ± 1,000 |\n"
    )


# --- mdpo-bench ----------------------------------------------------------------------------


def test_bench_measures_the_paper_preset(measured, tmp_path, capsys):
    assert bench.main(["paper-preset", *TOY_OPTIONS, "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr()
    records = Records(tmp_path / "runs.csv", paper_preset.COLUMNS, paper_preset.KEYS)
    assert without_seconds(records.rows) == without_seconds(measured.rows)
    assert printed.out == paper_preset_table(records)
    assert (tmp_path / "table.md").read_text(encoding="utf-8") == printed.out
    last = [float(row["last_return"]) for row in measured.rows[2:]]
    assert f"| {sum(last) / 2:,.0f} ± " in printed.out


def test_bench_sweeps_the_noise(swept, tmp_path, capsys):
    options = ["--alphas", "0.5", "2", "--sigma-maxes", "10", "--out", str(tmp_path)]
    assert bench.main(["noise-sweep", *TOY_OPTIONS, *options]) == 0
    assert (tmp_path / "sweep.csv").read_bytes() == swept.path.read_bytes()
    assert capsys.readouterr().out == sweep_table(swept)
    assert (tmp_path / "table.md").read_text(encoding="utf-8") == sweep_table(swept)


def test_bench_that_is_interrupted_says_how_to_go_on(measured, tmp_path, monkeypatch, capsys):
    arguments = ["paper-preset", *TOY_OPTIONS, "--out", str(tmp_path)]
    with monkeypatch.context() as patch:
        interrupt_training(patch, 1)
        assert bench.main(arguments) == 130
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.splitlines()[-1] == (
        "mdpo-bench: interrupted; the same command goes on from here"
    )
    assert not (tmp_path / "table.md").exists()
    assert bench.main(arguments) == 0
    records = Records(tmp_path / "runs.csv", paper_preset.COLUMNS, paper_preset.KEYS)
    assert without_seconds(records.rows) == without_seconds(measured.rows)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "the following arguments are required: COMMAND"),
        (["sweep"], "invalid choice: 'sweep'"),
        (["paper-preset", "--settings", "powergen8"], "invalid choice: 'powergen8'"),
        (["paper-preset", "--seeds", "0"], "--seeds: must be a positive integer, got '0'"),
        (["paper-preset", "--alphas", "1"], "unrecognized arguments: --alphas 1"),
        (["noise-sweep", "--alphas", "0"], "--alphas: must be a number above 0, got '0'"),
        (["noise-sweep", "--sigma-maxes", "-1"], "--sigma-maxes: must be a number at least 0"),
    ],
)
def test_bench_refuses_bad_options_in_one_line(capsys, arguments, complaint):
    with pytest.raises(SystemExit) as ended:
        bench.main(arguments)
    assert ended.value.code == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert line.startswith("mdpo-bench")
    assert complaint in line


def test_bench_names_the_file_that_it_cannot_use(tmp_path, capsys, monkeypatch):
    (tmp_path / "runs.csv").write_text("a,b\n")
    assert bench.main(["paper-preset", *TOY_OPTIONS, "--out", str(tmp_path)]) == 2
    path = tmp_path / "runs.csv"
    complaint = f"mdpo-bench: error: {path}: holds other results (columns a, b)\n"
    assert capsys.readouterr() == ("", complaint)

    monkeypatch.chdir(tmp_path)
    assert bench.main(["noise-sweep", *TOY_OPTIONS, "--out", str(tmp_path / "new")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("mdpo-bench: error: domains/powergen.rddl: cannot read")


def test_bench_that_cannot_write_the_table_keeps_the_rows(measured, tmp_path, capsys):
    (tmp_path / "table.md").mkdir()
    (tmp_path / "runs.csv").write_bytes(measured.path.read_bytes())
    assert bench.main(["paper-preset", *TOY_OPTIONS, "--out", str(tmp_path)]) == 2
    complaint = f"mdpo-bench: error: {tmp_path / 'table.md'}: cannot be written: Is a directory\n"
    assert capsys.readouterr() == ("", complaint)
    assert (tmp_path / "runs.csv").read_bytes() == measured.path.read_bytes()
