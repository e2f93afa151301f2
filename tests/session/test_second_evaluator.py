"""A second process that plays one policy: the same returns, or none."""

import json
import os
import signal
import subprocess
import sys

import jax
import numpy as np
import pytest
from helpers.problems import ROOT, shipped, tiny_files
from helpers.processes import is_alive

from mdpo_rddl.cli import plan
from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.planner.start import unit_hyperparams
from mdpo_rddl.policy.policy import Compiled, Policy
from mdpo_rddl.session import second_evaluator
from mdpo_rddl.session.evaluator import Evaluator
from mdpo_rddl.session.requests import PlanRequest
from mdpo_rddl.session.second_evaluator import SecondEvaluator


class Silent:
    def stage(self, name):
        """Nobody listens."""

    def episode(self, done, of):
        """Nobody listens."""


@pytest.fixture
def request_and_policy(tmp_path, monkeypatch):
    monkeypatch.setattr(second_evaluator, "usable_cores", lambda: 2)
    monkeypatch.setattr(second_evaluator, "_WORTH_STEPS", 6)
    problem = shipped("reservoir15", horizon=3)
    config = PRESETS["paper"]("Reservoir")
    request = PlanRequest(problem, config, "paper", 7, 2, tmp_path / "out")
    planner = build_planner(problem, config).planner
    hyperparams = unit_hyperparams(planner)
    structure = planner.params_structure(hyperparams)
    rng = np.random.default_rng(0)
    params = jax.tree.map(lambda leaf: rng.normal(size=leaf.shape).astype(leaf.dtype), structure)
    return request, planner, params, hyperparams


def full(*_):
    raise InputError("no space left")


def no_process(*_, **__):
    raise BlockingIOError("Resource temporarily unavailable")


@pytest.mark.parametrize(("name", "failing"), [("Child", no_process), ("save_policy", full)])
def test_without_the_second_process_the_first_plays(
    request_and_policy, monkeypatch, caplog, name, failing
):
    caplog.set_level("INFO")
    request, _, params, hyperparams = request_and_policy
    monkeypatch.setattr(second_evaluator, name, failing)
    with SecondEvaluator(request) as second:
        second.begin(params, hyperparams)
        assert second.result() is None
    assert "the second process: " in caplog.text


def test_both_processes_find_the_same_returns(request_and_policy, monkeypatch):
    request, planner, params, hyperparams = request_and_policy
    policy = Policy(
        request.problem,
        request.config,
        params,
        hyperparams,
        request.seed,
        compiled=Compiled(planner),
    )
    here = Evaluator(request, Silent()).run(policy)
    monkeypatch.setattr(second_evaluator, "evaluate", None)  # here, but not there
    with SecondEvaluator(request) as second:
        second.begin(params, hyperparams)
        there = second.result()
    np.testing.assert_array_equal(there.returns, here.returns)
    np.testing.assert_array_equal(there.lengths, here.lengths)
    assert len(set(here.returns)) == 2


def test_no_result_from_a_process_that_died(request_and_policy):
    request, _, params, hyperparams = request_and_policy
    with SecondEvaluator(request) as second:
        os.kill(second._child.pid, signal.SIGKILL)
        second.begin(params, hyperparams)
        assert second.result() is None


def test_no_result_from_a_policy_that_cannot_be_played(request_and_policy):
    request, _, _, hyperparams = request_and_policy
    with SecondEvaluator(request) as second:
        second.begin({"not": np.zeros(1)}, hyperparams)
        assert second.result() is None


@pytest.mark.parametrize("reason", ["few steps", "one core"])
def test_no_process_where_it_is_not_worth_its_while(request_and_policy, monkeypatch, reason):
    request, _, params, hyperparams = request_and_policy
    if reason == "few steps":
        monkeypatch.setattr(second_evaluator, "_WORTH_STEPS", 7)
    else:
        monkeypatch.setattr(second_evaluator, "usable_cores", lambda: 1)
    with SecondEvaluator(request) as second:
        assert second._child is None
        second.begin(params, hyperparams)
        assert second.result() is None


def test_the_process_ends_with_the_block(request_and_policy):
    request, *_ = request_and_policy
    with SecondEvaluator(request) as second:
        pid = second._child.pid
        assert is_alive(pid)
    assert not is_alive(pid)


@pytest.mark.long
def test_the_command_reports_the_same_with_and_without_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(second_evaluator, "usable_cores", lambda: 2)
    arguments = ["domains/powergen.rddl", "instances/powergen7.rddl", "--quiet", "--json"]
    arguments += ["--iterations", "20", "--episodes", "2", "--horizon", "3", "--no-cache"]
    asked = []
    found = SecondEvaluator.result
    monkeypatch.setattr(
        SecondEvaluator, "result", lambda self: asked.append(found(self)) or asked[-1]
    )
    summaries = []
    for worth in (1, 1000):
        monkeypatch.setattr(second_evaluator, "_WORTH_STEPS", worth)
        assert plan.main([*arguments, "--out", str(tmp_path / str(worth))]) == 0
        summaries.append(json.loads(capsys.readouterr().out))
    assert [evaluation is None for evaluation in asked] == [False, True]
    beside, alone = summaries
    assert beside["returns"] == alone["returns"]
    assert beside["last_iterate"] == alone["last_iterate"]


COMMAND = """
import sys
from mdpo_rddl.cli import plan
from mdpo_rddl.session import plan as session
from mdpo_rddl.policy.policy import Compiled, Policy
from mdpo_rddl.session import second_evaluator

second_evaluator.usable_cores = lambda: 2
second_evaluator._WORTH_STEPS = 1
played = []

class Noting(second_evaluator.SecondEvaluator):
    def result(self):
        played.append(super().result())
        return played[-1]

session.SecondEvaluator = Noting
status = plan.main(sys.argv[1:])
sys.exit(status or [one is None for one in played] != [False])
"""


@pytest.mark.long
@pytest.mark.parametrize("keeps", [True, False])
def test_no_process_of_a_command_keeps_anything_unless_it_may(tmp_path, keeps):
    domain, instance = tiny_files(tmp_path)
    cache, home = tmp_path / "cache", tmp_path / "home"
    paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
    variables = {"JAX_COMPILATION_CACHE_DIR": str(cache), "XDG_CACHE_HOME": str(home)}
    arguments = [domain, instance, "--iterations", "2", "--episodes", "2", "--quiet"]
    arguments += [] if keeps else ["--no-cache"]
    subprocess.run(
        [sys.executable, "-c", COMMAND, *arguments, "--out", str(tmp_path / "run")],
        env={**os.environ, "PYTHONPATH": paths, **variables},
        check=True,
    )
    assert (tmp_path / "run" / "summary.json").is_file()
    assert cache.exists() == keeps
    assert (cache / "grammar-tables").is_file() == keeps
    assert not (home / "mdpo-rddl").exists()
