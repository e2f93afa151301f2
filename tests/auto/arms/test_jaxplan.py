"""JaxPlan's planners in a second process: what comes back, and when nothing does."""

import os
import signal
import time

import numpy as np
import pytest
from helpers.problems import tiny_files
from helpers.processes import is_alive

from mdpo_rddl.auto.arena.judge import ROLLOUTS, MeanReturn
from mdpo_rddl.auto.arms import jaxplan
from mdpo_rddl.auto.arms.jaxplan import Alternatives, JaxPlanArm
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.problem.load import load_problem


@pytest.fixture
def problem(tmp_path):
    return load_problem(*tiny_files(tmp_path))


@pytest.fixture(autouse=True)
def two_cores(monkeypatch):
    monkeypatch.setattr(jaxplan, "usable_cores", lambda: 2)


@pytest.mark.slow
def test_a_trained_policy_comes_back_as_files(problem):
    with Alternatives(problem, seed=0, seconds=12.0, wanted=True) as others:
        pid = others._child.pid
        found = others.best(until=time.monotonic() + 300.0)
        names = {path.name for path in others._child.folder.iterdir()}
    assert not is_alive(pid)
    assert names == {"log", "slp.safetensors", "drp.safetensors"}
    assert found.name in {f"JaxPlan's default {method}" for method in jaxplan.METHODS}
    planner = build_planner(problem, found.config).planner
    assert planner.horizon == problem.horizon
    # the same return in this process, and better than doing nothing: 2 units at 0.5 for 4 steps
    mean, error = MeanReturn(planner, ROLLOUTS, 0)(found.params)
    assert (mean, error) == pytest.approx((found.mean, found.error))
    assert mean > -2.0
    assert found.iterations > 1


@pytest.mark.slow
def test_the_arm_offers_what_the_process_found(problem):
    with Alternatives(problem, seed=0, seconds=12.0, wanted=True) as alternatives:
        assert alternatives.started
        arm = JaxPlanArm(alternatives, time.monotonic)
        arm.work(time.monotonic() + 100.0)
    (candidate,) = arm.take_candidates()
    assert candidate.label in {f"JaxPlan's default {method}" for method in jaxplan.METHODS}
    assert np.isfinite(candidate.known_mean)
    assert arm.log.iterations > 0
    assert not candidate.uses_noise


def test_a_process_that_is_late_or_killed_costs_nothing_else(problem, caplog):
    caplog.set_level("INFO", logger=jaxplan.__name__)
    with Alternatives(problem, seed=0, seconds=60.0, wanted=True) as others:
        assert others.best(until=time.monotonic()) is None
        assert "is late" in caplog.text
        os.kill(others._child.pid, signal.SIGKILL)
        assert others.best(until=time.monotonic() + 60.0) is None
        assert "killed by SIGKILL" in caplog.text
        others.stop()
        assert others.best(until=time.monotonic() + 60.0) is None


class Answering:
    """Stands for a process that has trained on some problem."""

    def __init__(self, answers, folder):
        self.answers, self.folder = iter(answers), folder

    def answer(self, seconds):
        return next(self.answers)

    def end(self):
        """There is nothing to end."""


@pytest.mark.long
def test_policies_are_taken_for_their_own_problem_only(problem, tmp_path, monkeypatch):
    monkeypatch.setattr(jaxplan, "_SHARE", 0.0)  # one second
    folders = [tmp_path / name for name in ("policies", "other")]
    for folder in folders:
        folder.mkdir()
    other = load_problem(*tiny_files(folders[1], spread=1.0))
    request = jaxplan.ChildRequest({}, 0, 1.0, str(folders[0]))
    answer = {"method": "slp", **jaxplan._train(problem, request, "slp")}
    for planned, is_taken in ((problem, True), (other, False)):
        with Alternatives(planned, seed=0, seconds=1.0, wanted=False) as others:
            answers = [answer, {"method": "drp", "cause": "diverged"}]
            others._child = Answering(answers, folders[0])
            found = others.best(until=time.monotonic() + 10.0)
        assert (found is not None) == is_taken
        if found is not None:
            assert found.mean == answer["mean"]


def test_one_core_is_not_shared(problem, monkeypatch):
    monkeypatch.setattr(jaxplan, "usable_cores", lambda: 1)
    with Alternatives(problem, seed=0, seconds=60.0, wanted=True) as others:
        assert others._child is None
        assert others.best(until=time.monotonic()) is None
