"""The README keeps its word: its code runs, its options exist, its figures are the results'."""

import re

import numpy as np
from problems import ROOT

from mdpo_rddl.cli.options import plan_parser

README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_python_example_runs(monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    quick = code.replace("epochs=1000", "epochs=2, print_summary=False, print_progress=False")
    quick = quick.replace("episodes=20", "episodes=1").replace('.rddl")', '.rddl", horizon=5)')
    assert quick.count("horizon=5") == 1
    monkeypatch.chdir(ROOT)
    names: dict = {}
    exec(compile(quick, "README.md", "exec"), names)
    printed = capsys.readouterr().out
    assert "'mean'" in printed
    assert np.isfinite(names["agent"].callback["best_return"])


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
