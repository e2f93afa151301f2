"""The linear systems of `tools/linear_quadratic.py`, and their optimum."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

import mdpo_rddl as mdpo

TOOLS = Path(__file__).resolve().parents[2] / "tools"


@pytest.fixture(scope="module")
def tool():
    with pytest.MonkeyPatch.context() as patched:
        patched.syspath_prepend(str(TOOLS))
        spec = importlib.util.spec_from_file_location(
            "linear_quadratic", TOOLS / "linear_quadratic.py"
        )
        module = importlib.util.module_from_spec(spec)
        patched.setitem(sys.modules, spec.name, module)
        spec.loader.exec_module(module)
        yield module


@pytest.mark.parametrize(
    ("name", "form"), [("double integrator", "scalars"), ("pendulum on a cart", "objects")]
)
def test_the_optimal_gains_return_the_optimum_on_the_environment(tool, tmp_path, name, form):
    system = tool.SYSTEMS[name]()
    gains, optimum = system.gains()
    path = tmp_path / "linear.rddl"
    path.write_text(tool.FORMS[form](system))
    env = mdpo.make_environment(mdpo.load_problem(str(path)))
    best = mdpo.evaluate(env, tool.optimal_policy(gains, form), 20, 1).returns
    assert abs(best.mean() - optimum) < 4.0 * best.std(ddof=1) / np.sqrt(len(best))
    # and gains that are a tenth off cost more in the same episodes
    worse = mdpo.evaluate(env, tool.optimal_policy([1.1 * k for k in gains], form), 20, 1).returns
    assert worse.mean() < best.mean()


def test_without_noise_both_forms_return_the_optimum_to_the_letter(tool, tmp_path):
    system = tool.System(
        np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.0], [0.1]]), np.ones(2), 0.0, 9
    )
    gains, optimum = system.gains()
    for form in tool.FORMS:
        path = tmp_path / f"{form}.rddl"
        path.write_text(tool.FORMS[form](system))
        env = mdpo.make_environment(mdpo.load_problem(str(path)))
        (found,) = mdpo.evaluate(env, tool.optimal_policy(gains, form), 1, 0).returns
        assert found == pytest.approx(optimum, rel=1e-9)
