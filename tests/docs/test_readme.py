"""The README keeps its word: its code runs, its options exist, its figures are the results'."""

import ast
import csv
import dataclasses
import json
import re
import subprocess
import sys
import tomllib

from helpers.problems import ROOT

import mdpo_rddl
from mdpo_rddl.bench.presets.auto_variants import VARIANTS
from mdpo_rddl.cli.options import plan_parser

SETTINGS = ("hvac10", "hvac20", "powergen7", "powergen11", "reservoir15", "reservoir30")
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_python_example_runs(tmp_path):
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    quick = code.replace("seconds=60", "seconds=5, preset='paper', horizon=5")
    quick = quick.replace("episodes=50", "episodes=2").replace("hvac10.policy", "p.policy")
    for folder in ("domains", "instances"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    # in a process of its own, where nothing was imported before
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", quick], cwd=tmp_path, capture_output=True, text=True
    )
    assert "Traceback" not in done.stderr
    low, high = ast.literal_eval(done.stdout.splitlines()[-1])
    assert -1e7 < low <= high < 0.0
    assert (tmp_path / "p.policy").is_file()


def test_every_option_is_described_and_every_described_option_exists():
    table = README[README.index("## The command") : README.index("## In Python")]
    described = set(re.findall(r"--[a-z][a-z-]*", table))
    known = {name for action in plan_parser()._actions for name in action.option_strings}
    assert described == known - {"-h", "--help"}


def test_the_measured_table_is_the_one_in_results():
    rows = (ROOT / "results" / "paper_preset" / "table.md").read_text().splitlines()
    assert len(rows) == 2 + 6
    for row in rows:
        assert row in README
    sweep = (ROOT / "results" / "noise_sweep" / "table.md").read_text()
    assert sweep.count("\n") > 10


def test_the_table_of_auto_is_the_one_in_results():
    rows = (ROOT / "results" / "auto" / "table.md").read_text().splitlines()
    assert len(rows) == 2 + 2 * 6
    for row in rows:
        assert row in README


def test_the_table_against_jaxplan_is_the_one_in_results():
    with (ROOT / "results" / "auto_jaxplan" / "runs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    returns = {(row["problem"], row["planner"]): float(row["mean_return"]) for row in rows}
    problems = {problem for problem, _ in returns}
    assert len(problems) == 15
    for problem in problems:
        ours, slp, drp = (
            f"{returns[problem, planner]:,.0f}"
            for planner in ("auto", "jaxplan-slp", "jaxplan-drp")
        )
        name = problem.replace("_ippc2023:", " ")
        assert f"| {name} | **{ours}** | {slp} | {drp} |" in README


def test_the_ablation_in_the_docs_is_the_one_in_results():
    docs = (ROOT / "docs" / "auto.md").read_text(encoding="utf-8")
    with (ROOT / "results" / "auto_ablation" / "runs.csv").open(newline="") as file:
        returns = {
            (r["problem"], r["planner"]): float(r["mean_return"]) for r in csv.DictReader(file)
        }
    planners = {planner for _, planner in returns}
    assert "auto" in planners <= set(VARIANTS)
    for planner in planners:
        cells = [f"{returns[name, planner]:,.0f}" for name in SETTINGS]
        assert f"| {planner} | {' | '.join(cells)} |" in docs


def test_the_papers_table_is_the_one_in_results():
    cells = json.loads((ROOT / "results" / "paper" / "table.json").read_text())["cells"]
    assert len(cells) == 36
    for cell in cells:
        assert f"{cell['mean']:,.0f} ± {cell['std']:,.0f}" in README
        assert f"{cell['paper_mean']:,.0f} ± {cell['paper_std']:,.0f}" in README


def test_the_version_is_the_same_everywhere():
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert mdpo_rddl.__version__ == declared
    assert f"version: {declared}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"## [{declared}]" in (ROOT / "CHANGELOG.md").read_text()


def test_the_documented_configuration_loads_with_the_documented_defaults():
    page = (ROOT / "docs" / "configuration.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```ini\n(.*?)```", page, flags=re.DOTALL)
    planner_args, _, _ = mdpo_rddl.load_config_from_string(example)
    assert planner_args["noise"] == mdpo_rddl.AdaptiveNoise(sigma_max=0.2, alpha=2.0)
    assert planner_args["stop_at_termination"] is True
    for rule in (mdpo_rddl.AdaptiveNoise(), mdpo_rddl.ConstantNoise(), mdpo_rddl.AnnealedNoise()):
        for field in dataclasses.fields(rule):
            value = repr(getattr(rule, field.name)).replace("e-08", "e-8")
            assert f"`{field.name}={value}`" in page
