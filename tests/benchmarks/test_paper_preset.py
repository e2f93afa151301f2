"""The measurement of the paper's preset: as `mdpo-plan` gives it, stopped and resumed."""

import json
from collections.abc import Iterator
from dataclasses import replace

import pytest
from helpers.toy_experiments import (
    OPTIONS,
    SETTINGS,
    SIZE,
    compiled_once,
    interrupt_training,
    nothing_to_do,
)

from benchmarks import main as bench
from benchmarks.common import full_training
from benchmarks.common.records import Records
from benchmarks.presets import paper_preset
from benchmarks.presets.paper_preset import paper_preset_table, run_paper_preset
from mdpo_rddl.cli import plan

pytestmark = pytest.mark.long

MEASUREMENT = {"settings": SETTINGS, "noises": ["none", "adaptive"], "size": SIZE}


@pytest.fixture(scope="module", autouse=True)
def toy() -> Iterator[None]:
    with compiled_once():
        yield


@pytest.fixture(scope="module")
def measured(toy, tmp_path_factory) -> Records:
    return run_paper_preset(tmp_path_factory.mktemp("paper"), **MEASUREMENT)


def without_seconds(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    return [{k: v for k, v in row.items() if k != "train_seconds"} for row in rows]


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
    monkeypatch.setattr(full_training, "train", nothing_to_do)
    monkeypatch.setattr(paper_preset, "build_planner", nothing_to_do)
    again = run_paper_preset(measured.path.parent, **MEASUREMENT)
    assert again.rows == measured.rows
    assert measured.path.read_bytes() == written


@pytest.mark.long
@pytest.mark.parametrize("finished", [0, 3])
def test_a_paper_preset_stopped_in_a_training_goes_on(measured, tmp_path, monkeypatch, finished):
    with monkeypatch.context() as patch:
        interrupt_training(patch, finished)
        with pytest.raises(KeyboardInterrupt):
            run_paper_preset(tmp_path, **MEASUREMENT)
    stopped = Records(tmp_path / "runs.csv", paper_preset.COLUMNS, paper_preset.KEYS)
    assert without_seconds(stopped.rows) == without_seconds(measured.rows[:finished])
    resumed = run_paper_preset(tmp_path, **MEASUREMENT)
    assert without_seconds(resumed.rows) == without_seconds(measured.rows)


@pytest.mark.long
def test_more_seeds_leave_those_that_are_there(measured, tmp_path):
    one = run_paper_preset(tmp_path, **MEASUREMENT | {"size": replace(SIZE, seeds=1)})
    assert without_seconds(one.rows) == without_seconds(measured.rows[0::2])
    two = run_paper_preset(tmp_path, **MEASUREMENT)
    assert two.rows[:2] == one.rows
    assert without_seconds(two.rows[2:]) == without_seconds(measured.rows[1::2])


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


def test_bench_measures_the_paper_preset(measured, tmp_path, capsys):
    assert bench.main(["paper-preset", *OPTIONS, "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr()
    records = Records(tmp_path / "runs.csv", paper_preset.COLUMNS, paper_preset.KEYS)
    assert without_seconds(records.rows) == without_seconds(measured.rows)
    assert printed.out == paper_preset_table(records)
    assert (tmp_path / "table.md").read_text(encoding="utf-8") == printed.out
    last = [float(row["last_return"]) for row in measured.rows[2:]]
    assert f"| {sum(last) / 2:,.0f} ± " in printed.out


def test_bench_that_is_interrupted_says_how_to_go_on(measured, tmp_path, monkeypatch, capsys):
    arguments = ["paper-preset", *OPTIONS, "--out", str(tmp_path)]
    with monkeypatch.context() as patch:
        interrupt_training(patch, 1)
        assert bench.main(arguments) == 130
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.splitlines()[-1] == (
        "benchmarks: interrupted; the same command goes on from here"
    )
    assert not (tmp_path / "table.md").exists()
    assert bench.main(arguments) == 0
    records = Records(tmp_path / "runs.csv", paper_preset.COLUMNS, paper_preset.KEYS)
    assert without_seconds(records.rows) == without_seconds(measured.rows)


def test_bench_that_cannot_write_the_table_keeps_the_rows(measured, tmp_path, capsys):
    (tmp_path / "table.md").mkdir()
    (tmp_path / "runs.csv").write_bytes(measured.path.read_bytes())
    assert bench.main(["paper-preset", *OPTIONS, "--out", str(tmp_path)]) == 2
    complaint = f"benchmarks: error: {tmp_path / 'table.md'}: cannot be written: Is a directory\n"
    assert capsys.readouterr() == ("", complaint)
    assert (tmp_path / "runs.csv").read_bytes() == measured.path.read_bytes()
