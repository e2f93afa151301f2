"""Which device suits a problem."""

import os
import subprocess
import sys
from types import SimpleNamespace

import jax
import pytest
from helpers.problems import tiny_files

from mdpo_rddl.machine.device import computing_on
from mdpo_rddl.planner import device as module
from mdpo_rddl.planner.device import MANY_VALUES, fitting_device
from mdpo_rddl.problem.load import load_problem

# a policy found on the second of two devices is played there, whatever the default
PLAYED = """
import sys

import jax
from mdpo_rddl.machine.device import computing_on, current_device
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets import PRESETS
from mdpo_rddl.problem.load import load_problem

second = jax.devices()[1]
problem = load_problem(*sys.argv[1:])
with computing_on(second):
    planner = build_planner(problem, PRESETS["paper"]("tiny")).planner
with planner.computing():
    assert current_device() == second
assert current_device() == jax.devices()[0]
"""


@pytest.fixture
def problem(tmp_path):
    return load_problem(*tiny_files(tmp_path))


def accelerator(monkeypatch):
    """As on a machine with one."""
    found = {name: SimpleNamespace(platform=name) for name in ("gpu", "cpu")}
    monkeypatch.setattr(jax, "devices", lambda platform="gpu": [found[platform]])
    return found


@pytest.fixture
def platforms():
    """Names them as JAX_PLATFORMS does."""
    before = jax.config.values["jax_platforms"]
    yield lambda names: jax.config.update("jax_platforms", names)
    jax.config.update("jax_platforms", before)


def test_where_there_is_only_the_cpu_nothing_is_chosen(problem):
    assert fitting_device(problem) is None


@pytest.mark.parametrize(
    ("values", "named", "expected"),
    [
        (MANY_VALUES - 1, None, "cpu"),
        (MANY_VALUES, None, None),
        # whoever says in which order they come means it
        (MANY_VALUES - 1, "gpu,cpu", None),
    ],
)
def test_small_models_stay_on_the_cpu(monkeypatch, platforms, problem, values, named, expected):
    platforms(named)
    found = accelerator(monkeypatch)
    monkeypatch.setattr(module, "step_values", lambda ast: values)
    assert fitting_device(problem) is found.get(expected)


def test_what_the_user_has_chosen_stands(monkeypatch, problem):
    chosen = jax.devices("cpu")[0]
    with computing_on(chosen):
        accelerator(monkeypatch)
        assert fitting_device(problem) is chosen


def test_a_planner_computes_where_it_was_compiled(tmp_path):
    variables = {**os.environ, "JAX_NUM_CPU_DEVICES": "2"}
    files = map(str, tiny_files(tmp_path))
    subprocess.run([sys.executable, "-c", PLAYED, *files], env=variables, check=True)
