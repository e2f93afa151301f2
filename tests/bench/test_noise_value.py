"""What noise is worth: cells that are measured once, their statistics and the report."""

from pathlib import Path

import numpy as np
import pytest
from helpers.problems import tiny_files
from scipy import stats

from mdpo_rddl.bench.noise_value import problems, run
from mdpo_rddl.bench.noise_value.cells import Cell, load, save
from mdpo_rddl.bench.noise_value.methods import METHODS, cell_config
from mdpo_rddl.bench.noise_value.report import write_report
from mdpo_rddl.bench.noise_value.statistics import holm, mean_interval, normalised, paired_p
from mdpo_rddl.cli import bench
from mdpo_rddl.errors import InputError
from mdpo_rddl.machine.executors import make_executor
from mdpo_rddl.noise import AnnealedNoise
from mdpo_rddl.problem.load import load_problem

SIZES = {"seeds": 2, "iterations": 3, "max_horizon": 3, "rollouts": 40}


def cell(out: Path, method: str = "none", problem: str = "Toy", **others) -> Cell:
    names = {"problem": problem, "instance": "1", "plan": "slp", "configuration": "no-pgpe"}
    return Cell(out, **names, method=method, **{**SIZES, **others})


def test_the_default_is_measured_without_a_section_and_the_others_with_theirs():
    for method, section in METHODS.items():
        config = cell_config("Reservoir_ippc2023", "slp", "own", method)
        assert config.section("Noise") == (section or {})
    assert cell_config("HVAC_ippc2023", "drp", "own", "default").noise() == AnnealedNoise()
    twice = cell_config("HVAC_ippc2023", "drp", "no-pgpe", "none-twice").section("Planner")
    assert (twice["parallel_updates"], twice["pgpe"]) == (2, None)


@pytest.mark.long
def test_cells_are_trained_once_and_reported(tmp_path, monkeypatch, capsys):
    files = tiny_files(tmp_path, horizon=4, spread=0.1)
    monkeypatch.setattr(run, "load_problem", lambda *names: load_problem(*files, *names[2:]))
    monkeypatch.setattr(problems, "repository", lambda: ["Toy"])
    out = tmp_path / "out"
    arguments = ["noise-value", "--problems", "Toy:1", "--plans", "slp", "--methods", "none"]
    arguments += ["default", "--configurations", "no-pgpe", "--seeds", "2", "--iterations", "3"]
    arguments += ["--max-horizon", "3", "--rollouts", "40", "--out", str(out)]
    assert bench.main([*arguments, "--shard", "2/2"]) == 0
    assert [path.stem for path in (out / "cells").iterdir()] == ["Toy_1_slp_no-pgpe_default"]
    assert bench.main(arguments) == 0
    table = capsys.readouterr().out
    assert "| Toy | 1 | slp | no-pgpe |" in table
    assert (out / "strips.png").stat().st_size > 0
    assert (out / "curves.png").stat().st_size > 0
    kept = load(cell(out, "default"))
    assert len(kept["returns"]) == 2
    assert len(kept["curves"][0]) == len(kept["curve_iterations"]) == 3
    assert kept["units"] == {"push": [2.0, 2.0]}  # the box is from -1 to 1

    monkeypatch.setattr(run, "_measure", None)  # there is nothing left to do
    run.run_noise_value([cell(out), cell(out, "default")], make_executor("local", {}))
    with pytest.raises(InputError, match="was made with another seeds"):
        load(cell(out, seeds=3))


def test_what_fails_is_kept_as_a_finding(tmp_path, monkeypatch):
    def fail(cell):
        raise ValueError("no such thing")

    monkeypatch.setattr(run, "_measure", fail)
    run.run_cell(cell(tmp_path))
    assert load(cell(tmp_path))["status"] == "no such thing"
    assert "Not measured: Toy_1_slp_no-pgpe_none." in write_report(tmp_path)


def result(returns: list[float], noop: float | None = None, seconds: float = 1.0) -> dict:
    curves = [[0.0, value] for value in returns]
    spent = [seconds] * len(returns)
    found = {"status": "ok", "returns": returns, "noop": noop, "train_seconds": spent}
    return {**found, "curves": curves, "curve_iterations": [0, 9]}


def test_the_report_says_where_noise_is_better_and_worse_and_what_it_costs(tmp_path):
    for problem, lead in (("Gains", 5.0), ("Loses", -5.0), ("Same", 0.0)):
        base = np.array([10.0, 11.0, 12.0])
        save(cell(tmp_path, problem=problem, seeds=3), result(base.tolist(), noop=0.0))
        ours = base + lead + np.array([0.0, 0.01, -0.01]) * bool(lead)
        save(cell(tmp_path, "default", problem, seeds=3), result(ours.tolist(), seconds=1.5))
    lines = write_report(tmp_path).splitlines()
    row = next(line for line in lines if line.startswith("| default"))
    assert row.split("|")[2].strip() == "3"
    assert [part.strip() for part in row.split("|")[4:7]] == ["1", "1", "1.50"]
    assert "| Gains | 1 | slp | no-pgpe | 0 | 11 | 16 \\* |" in lines
    assert "| Same | 1 | slp | no-pgpe | 0 | 11 | 11 |" in lines


def test_the_paired_test_is_student_s():
    ours, theirs = np.array([1.0, 2.0, 4.0, 3.5]), np.array([0.5, 2.1, 3.0, 3.0])
    assert paired_p(ours, theirs) == pytest.approx(stats.ttest_rel(ours, theirs).pvalue)
    assert paired_p(ours, ours) == 1.0
    assert paired_p(ours, ours - 1.0) == 0.0


def test_holm_worked_by_hand():
    # sorted 0.01 0.02 0.03 0.5, times 4 3 2 1, never falling
    np.testing.assert_allclose(holm([0.03, 0.01, 0.5, 0.02]), [0.06, 0.04, 0.5, 0.06])


def test_scores_are_0_at_the_no_op_and_1_at_the_best_mean():
    scores = normalised({"a": np.array([5.0, 15.0]), "b": np.array([-10.0, 5.0])}, 0.0)
    np.testing.assert_allclose(scores["a"], [0.5, 1.0])
    np.testing.assert_allclose(scores["b"], [0.0, 0.5])
    assert not np.any(normalised({"a": np.array([-1.0])}, 0.0)["a"])


def test_the_interval_resamples_the_seeds_of_each_problem():
    mean, low, high = mean_interval([np.full(5, 0.2), np.full(5, 0.6)])
    assert (mean, low, high) == pytest.approx((0.4, 0.4, 0.4))
    mean, low, high = mean_interval([np.array([0.0, 1.0])])
    assert (mean, low, high) == pytest.approx((0.5, 0.0, 1.0))


@pytest.mark.parametrize("shard", ["0/2", "3/2", "1", "a/b"])
def test_a_shard_that_is_none(shard, capsys):
    with pytest.raises(SystemExit):
        bench.main(["noise-value", "--shard", shard])
    assert "must be I/N" in capsys.readouterr().err


def test_an_unknown_problem_is_named():
    with pytest.raises(InputError, match="has no problem 'Nowhere'"):
        problems.with_instances(["Nowhere"])


def test_the_competition_s_problems_have_five_instances():
    assert problems.with_instances(["HVAC_ippc2023"]) == [("HVAC_ippc2023", n) for n in "12345"]
    assert problems.with_instances(["Elevators:0"]) == [("Elevators", "0")]
