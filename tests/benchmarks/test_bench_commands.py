"""Measurements that no other file runs: each once, on a problem of its own size."""

import pytest
from helpers.problems import tiny_files
from helpers.workers import in_this_process

from benchmarks import main as bench
from benchmarks.configs import sweep
from benchmarks.configs.choice import BASELINE, NOOP
from benchmarks.presets import auto
from benchmarks.speed import growth, profile, speed
from benchmarks.speed.speed import Case
from mdpo_rddl.problem.load import load_problem

pytestmark = pytest.mark.long


@pytest.fixture
def problem(tmp_path):
    return load_problem(*tiny_files(tmp_path, horizon=3, spread=0.3))


@pytest.fixture
def command(tmp_path, capsys):
    """Runs a command; returns its table's lines that follow the head."""

    def run(arguments):
        out = tmp_path / "out"
        assert bench.main([*arguments.split(), "--out", str(out)]) == 0
        printed = capsys.readouterr().out
        assert printed == (out / "table.md").read_text()
        return printed.splitlines()[2:]

    return run


def test_speed(problem, command, monkeypatch):
    monkeypatch.setattr(speed, "load_setting", lambda name: problem)
    monkeypatch.setattr(speed, "CASES", (Case("adaptive", 1, 50, speed.JAXPLAN, 2.0),))
    lines = command("speed --settings hvac10 --turns 1 --seconds 0.05 --command-turns 0")
    assert lines[0].startswith("| hvac10 | adaptive | 1 | 50 | JaxPlan |")


@pytest.mark.slow
def test_profile(problem, command, monkeypatch):
    monkeypatch.setattr(speed, "load_setting", lambda name: problem)
    monkeypatch.setattr(profile, "SEEDS", (1,))
    (line, *_) = command("profile --settings hvac10 --turns 1 --seconds 0.05")
    assert line.startswith("| hvac10 | 1 |")


def test_growth(problem, command, monkeypatch, tmp_path):
    monkeypatch.setattr(growth, "AXES", {**growth.AXES, "horizon": (2,)})
    monkeypatch.setattr(growth, "load_setting", lambda name: problem)
    monkeypatch.setattr(growth, "load_problem", lambda *_: problem)
    monkeypatch.setattr(growth, "run_guarded", in_this_process)
    (line, *_) = command("growth --axes horizon --seconds 0.05")
    assert line.startswith("| horizon | 2 |")
    assert (tmp_path / "out" / "growth.png").is_file()


@pytest.mark.long
def test_auto_against_jaxplan(problem, command, monkeypatch):
    monkeypatch.setattr(auto, "load_problem", lambda *_: problem)
    options = "--problems Tiny:1 --planners jaxplan-slp --seeds 2 --seconds 0.05 --episodes 2"
    command(f"auto {options}")


def test_configs(problem, command, monkeypatch, tmp_path):
    monkeypatch.setattr(sweep, "load_problem", lambda *_: problem)
    monkeypatch.setattr(sweep, "run_guarded", in_this_process)
    options = "--domains HVAC --instances 1 --plans slp --candidates jaxplan --seconds 0.05"
    (tmp_path / "ship").mkdir()
    (line,) = command(f"configs {options} --episodes 2 --ship {tmp_path / 'ship'}")
    assert line.startswith("| HVAC_ippc2023 | 1 | slp |")
    rows = sweep.Records(tmp_path / "out" / "runs.csv", sweep.COLUMNS, sweep.KEYS).rows
    assert {row["candidate"]: row["status"] for row in rows} == {
        NOOP: "ok",
        BASELINE: "ok",
        "jaxplan": "ok",
    }
    (shipped,) = (tmp_path / "ship").iterdir()
    assert shipped.name == "HVAC_ippc2023_slp.cfg"
    assert shipped.read_text().startswith("# jaxplan: see results/configs\n")
