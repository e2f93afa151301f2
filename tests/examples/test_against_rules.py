"""The rules of `tools/rules`, and `tools/against_rules.py`, which plans for the same problems."""

import csv
import importlib.util
import sys
from pathlib import Path

import pyRDDLGym
import pytest

from mdpo_rddl.problem.load import load_problem

TOOLS = Path(__file__).resolve().parents[2] / "tools"


@pytest.fixture
def tool(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    spec = importlib.util.spec_from_file_location("against_rules", TOOLS / "against_rules.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "EPISODES", 2)
    return module


class Idle:
    """In place of a policy."""

    def __init__(self):
        self.resets = 0

    def reset(self):
        self.resets += 1

    def sample_action(self, state):
        return {}


@pytest.mark.parametrize("name", sorted(path.name for path in (TOOLS / "rules").iterdir()))
def test_a_rule_acts_in_its_problem(tool, name):
    load_problem(*tool.files_of(name))
    env = pyRDDLGym.make(*tool.files_of(name), vectorized=False, enforce_action_constraints=True)
    state, _ = env.reset(seed=1)
    rule = tool.rule_of(name)
    for step in range(3):
        # an action that is illegal, or none of the problem's, raises an error
        state, *_ = env.step(rule(state, step))


@pytest.mark.parametrize("name", ["fishery", "jobshop"])
def test_a_rule_is_legal_and_returns_more_than_the_no_op(tool, name):
    assert load_problem(*tool.files_of(name)).domain_name == name
    # an illegal action raises an error
    ruled = tool.returns(name, tool.rule_of(name))
    assert (ruled > tool.returns(name, lambda state, step: {})).all()


def test_a_row_is_added_once(tool, tmp_path, monkeypatch):
    policy, planned, path = Idle(), [], tmp_path / "rows.csv"

    def plan(domain, instance, *, seconds, seed):
        planned.append((Path(domain).parent.name, seconds, seed))
        return policy

    monkeypatch.setattr(tool.mdpo, "plan", plan)
    for seed in ("0", "0", "1"):
        monkeypatch.setattr(sys, "argv", ["against_rules.py", str(path), "60", seed, "jobshop"])
        tool.main()
    assert planned == [("jobshop", 60.0, 0), ("jobshop", 60.0, 1)]
    assert policy.resets == 4
    with path.open(newline="") as file:
        first, second = csv.DictReader(file)
    assert tuple(first) == tool.COLUMNS
    assert (first["seed"], second["seed"]) == ("0", "1")
    assert first["policy"] == first["noop"]
    assert float(first["lead"]) == pytest.approx(float(first["policy"]) - float(first["rule"]))
