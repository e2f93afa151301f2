"""The README keeps its word: its code runs, its options exist, its figures are the results'."""

import ast
import dataclasses
import json
import re
import subprocess
import sys
import tomllib

import pytest
from helpers.problems import ROOT

import mdpo_rddl
from benchmarks.tasks.published import published, read_published, score
from benchmarks.tasks.trial import Task
from mdpo_rddl.cli.options import plan_parser
from mdpo_rddl.noise import default_noise
from mdpo_rddl.planner.config.presets.paper import paper_preset
from mdpo_rddl.race.arms.ground import DYNAMIC_PROGRAMMING

SETTINGS = ("hvac10", "hvac20", "powergen7", "powergen11", "reservoir15", "reservoir30")
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.long
def test_the_python_example_runs(tmp_path):
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    quick = code.replace("seconds=60", "seconds=5, preset='paper', horizon=5")
    quick = quick.replace("episodes=50", "episodes=2").replace("hvac10.policy", "p.policy")
    # in a process of its own, where nothing was imported before
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", quick], cwd=tmp_path, capture_output=True, text=True
    )
    assert "Traceback" not in done.stderr
    low, high = ast.literal_eval(done.stdout.splitlines()[-1])
    assert -1e7 < low <= high < 0.0
    assert (tmp_path / "p.policy").is_file()


def test_it_can_be_read_in_a_sitting():
    assert len(README) < 8000


def test_every_option_is_described_and_every_described_option_exists():
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    table = page[page.index("| option |") : page.index("The run folder holds")]
    described = set(re.findall(r"--[a-z][a-z-]*", table))
    known = {name for action in plan_parser()._actions for name in action.option_strings}
    assert described == known - {"-h", "--help"}


def test_the_first_figures_are_those_of_the_published_tasks():
    table = (ROOT / "results" / "published" / "table.md").read_text(encoding="utf-8")
    reached, of, mean = re.search(
        r"above: (\d+) of (\d+)\. Mean score, each at most 1: ([\d.]+)\. ", table
    ).groups()
    flowing = " ".join(README.split())
    assert f"on {reached} of {of} public tasks, with a mean score of {float(mean):.2f}." in flowing
    (equal,) = re.findall(r"The same in equal steps: .*? or above: (\d+) of 81\.", table)
    assert f"in equal steps it is {equal}." in flowing
    assert "Mean below PROST's with 1 s: on 0 of 12 domains; " in table
    assert "All twelve domains' means are above PROST's with 1 s." in flowing


def test_as_many_proven_optima_are_below_the_best_as_it_says():
    tasks = published()
    below = [
        row
        for row in read_published(ROOT / "results" / "published" / "rows.csv").rows
        if score(float(row["mean"]), tasks[Task(row["problem"], row["instance"])]) < 0.99
    ]
    proven = sum(row["arms"] == DYNAMIC_PROGRAMMING for row in below)
    assert f"On {proven} of the {len(below)} below 0.99" in " ".join(README.split())


def test_the_figures_of_the_competition_of_2014_are_those_of_its_table():
    table = (ROOT / "results" / "ippc2014" / "table.md").read_text(encoding="utf-8")
    reached, of = re.search(r"or above: (\d+) of (\d+)\.", table).groups()
    said = f"ours is at 0.99 of PROST, the winner, or above on {reached}."
    assert of == "40"
    assert said in " ".join(README.split())
    traffic = re.findall(r"\| Traffic_\S+ \| \d+ \| (\S+) \| *\| \S+ \| (\S+) \|", table)
    ours, theirs = (sum(map(float, column)) / 5 for column in zip(*traffic, strict=True))
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    assert f"in the mean over Traffic it is level ({ours:.1f} and {theirs:.1f})." in page


def test_the_noise_s_figures_are_the_paper_run_s():
    cells = json.loads((ROOT / "results" / "paper" / "table.json").read_text())["cells"]
    tested = [cell["adaptive_p"] for cell in cells if cell["method"] == "deterministic"]
    assert len(tested) == 6
    assert max(tested) < 0.01


def test_what_noise_harms_is_what_was_measured():
    table = (ROOT / "results" / "noise_value" / "table.md").read_text(encoding="utf-8")
    row = re.search(r"\| constant beside \|(.*)\|\n", table)[1].split("|")
    tasks, _, better, worse, _, worse_uncorrected = (cell.strip() for cell in row)
    assert (worse, worse_uncorrected) == ("0", "0")
    said = f"keeps the better one: below JaxPlan on none of {tasks} tasks"
    assert said in " ".join(README.split())
    docs = " ".join((ROOT / "docs" / "noise.md").read_text(encoding="utf-8").split())
    assert f"is better than JaxPlan's planner on {better} tasks" in docs


def test_the_version_is_the_same_everywhere():
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert mdpo_rddl.__version__ == declared
    assert f"version: {declared}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"## [{declared}]" in (ROOT / "CHANGELOG.md").read_text()


def test_the_documented_configuration_loads_with_the_documented_defaults():
    page = (ROOT / "docs" / "configuration.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```ini\n(.*?)```", page, flags=re.DOTALL)
    planner_args, _, _ = mdpo_rddl.load_config_from_string(example)
    assert planner_args["configured_noise"] == mdpo_rddl.AdaptiveNoise(sigma_max=0.2, alpha=2.0)
    assert planner_args["stop_at_termination"] is True
    for rule in (mdpo_rddl.AdaptiveNoise(), mdpo_rddl.ConstantNoise(), mdpo_rddl.AnnealedNoise()):
        for field in dataclasses.fields(rule):
            value = repr(getattr(rule, field.name)).replace("e-08", "e-8")
            assert f"`{field.name}={value}`" in page


def test_the_documented_default_is_the_planner_s():
    docs = ROOT / "docs"
    page = " ".join((docs / "configuration.md").read_text(encoding="utf-8").split())
    values = re.search(r"which as a section is (.*?)\. \|", page)[1].replace("`", "").split(", ")
    paper = paper_preset("hvac").without_section("Noise")
    text = paper.to_text() + "\n".join(["[Noise]", *values])
    rule = mdpo_rddl.load_config_from_string(text)[0]["configured_noise"]
    assert rule == default_noise()
    # the words of the options' table and of a summary
    commands = (docs / "commands.md").read_text(encoding="utf-8")
    assert rule.paired
    assert "`--config` without `[Noise]`: constant, beside updates without noise" in commands
