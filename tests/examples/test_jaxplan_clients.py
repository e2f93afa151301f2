"""What others wrote for JaxPlan, run with one import changed."""

import csv
import runpy
import shutil
import subprocess
import sys
from typing import ClassVar

import numpy as np
import pytest
from helpers.problems import JAXPLAN_EXAMPLES as EXAMPLES
from helpers.problems import ROOT, tiny_files
from pyRDDLGym.core.env import RDDLEnv
from pyRDDLGym.core.policy import BaseAgent

from mdpo_rddl import MDPOPlanner
from mdpo_rddl.planner.upstream import JaxBackpropPlanner
from mdpo_rddl.planner.upstream import planner as jaxplan

pytestmark = pytest.mark.long

CLIENTS = ROOT / "examples" / "clients"
SCRIPTS = CLIENTS / "jaxplan_scripts.py"
write_script = runpy.run_path(str(SCRIPTS))["write_script"]

CONFIG = """
[Compiler]
method='DefaultJaxRDDLCompilerWithGrad'
print_warnings=False

[Planner]
method={method!r}
method_kwargs={{}}
optimizer='rmsprop'
optimizer_kwargs={{'learning_rate': 0.05}}
batch_size_train=2
pgpe=None
dashboard={dashboard}

[Optimize]
key=42
epochs=4
train_seconds=1e300
policy_hyperparams=1.0
print_summary=False
print_progress=False
{noise}
"""
SILENT = "[Noise]\nmethod='NoNoise'"
METHODS = {
    "slp": "JaxStraightLinePlan",
    "drp": "JaxDeepReactivePolicy",
    "replan": "JaxStraightLinePlan",
}


@pytest.fixture
def played(monkeypatch):
    """What every evaluation returned, and with which planner."""
    found = []
    evaluate = BaseAgent.evaluate

    def evaluated(agent, *arguments, **keywords):
        result = evaluate(agent, *arguments, **keywords)
        found.append((type(agent.planner), result))
        return result

    monkeypatch.setattr(BaseAgent, "evaluate", evaluated)
    monkeypatch.setattr(RDDLEnv, "render", lambda *a, **k: None)
    return found


def configs_of(folder, method, dashboard=False, noise=""):
    """A folder with a configuration of the name that a script looks for."""
    configs = folder / "configs"
    configs.mkdir()
    values = {"method": METHODS[method], "dashboard": dashboard, "noise": noise}
    (configs / f"default_{method}.cfg").write_text(CONFIG.format(**values))
    return configs


def changed_main(folder, name, configs):
    """The function `main` of a script whose import is changed."""
    (folder / "changed").mkdir()
    script = write_script(name, folder / "changed", configs)
    module = runpy.run_path(str(script))
    assert module["JaxBackpropPlanner"] is MDPOPlanner
    return module["main"]


def jaxplan_s_main(folder, name):
    """The function `main` of a script as it is, which reads the configurations in a folder."""
    script = folder / f"{name}.py"
    shutil.copyfile(EXAMPLES / script.name, script)
    return runpy.run_path(str(script))["main"]


@pytest.mark.parametrize(
    "method", ["slp", *(pytest.param(name, marks=pytest.mark.long) for name in ("drp", "replan"))]
)
def test_jaxplan_s_script_plays_the_same_episode_without_noise(tmp_path, played, method):
    files, configs = tiny_files(tmp_path), configs_of(tmp_path, method, noise=SILENT)
    # JaxPlan reads the file with [Noise] too
    jaxplan_s_main(tmp_path, "run_plan")(*files, method)
    changed_main(tmp_path, "run_plan", configs)(*files, method)
    (their_planner, theirs), (our_planner, ours) = played
    assert (their_planner, our_planner) == (JaxBackpropPlanner, MDPOPlanner)
    assert ours == theirs


def test_jaxplan_s_scipy_script_finds_the_optimum(tmp_path, played):
    main = changed_main(tmp_path, "run_scipy", configs_of(tmp_path, "slp"))
    main(*tiny_files(tmp_path), "BFGS")
    # both units are at the goal after the first action: only the first reward is lost
    ((_, result),) = played
    assert result["mean"] == pytest.approx(-2 * 0.5**2, abs=1e-4)


class Dashboard:
    """Stands in for JaxPlan's dashboard, which needs dash and a browser."""

    made: ClassVar[list] = []

    def __init__(self):
        self.launched, self.updates = False, 0
        self.made.append(self)

    @staticmethod
    def get_planner_info(planner):
        return planner

    def launch(self):
        self.launched = True

    def register_experiment(self, experiment_id, *arguments, **keywords):
        return experiment_id

    def update_experiment(self, experiment_id, callback):
        assert "sigma" in callback["train_log"]
        self.updates += 1


def test_jaxplan_s_script_shows_the_dashboard(tmp_path, played, monkeypatch):
    monkeypatch.setattr(jaxplan, "JaxPlannerDashboard", Dashboard, raising=False)
    Dashboard.made.clear()
    configs = configs_of(tmp_path, "slp", dashboard=True)
    changed_main(tmp_path, "run_plan", configs)(*tiny_files(tmp_path), "slp")
    (dashboard,) = Dashboard.made
    assert dashboard.launched
    assert dashboard.updates == 4


TUNED = """
[Compiler]
method='DefaultJaxRDDLCompilerWithGrad'
sigmoid_weight=MODEL_WEIGHT_TUNE
print_warnings=False

[Planner]
method='JaxStraightLinePlan'
method_kwargs={}
optimizer='rmsprop'
optimizer_kwargs={'learning_rate': LEARNING_RATE_TUNE}
batch_size_train=2
pgpe=None

[Optimize]
epochs=3
policy_hyperparams=POLICY_WEIGHT_TUNE
print_summary=False
print_progress=False
"""


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_jaxplan_s_tuning_script_tunes(tmp_path):
    pytest.importorskip("bayes_opt")
    configs = tmp_path / "configs"
    configs.mkdir()
    (configs / "tuning_slp.cfg").write_text(TUNED)
    (tmp_path / "changed").mkdir()
    script = write_script("run_tune", tmp_path / "changed", configs)
    problem = ["Reservoir_ippc2023", "1", "slp", "1", "1", "1"]
    subprocess.run([sys.executable, str(script), *problem], cwd=tmp_path, check=True)
    (log,) = tmp_path.glob("gp_slp_*.csv")
    (row,) = csv.DictReader(log.open(newline=""))
    assert np.isfinite(float(row["target"]))


def test_a_script_that_jaxplan_lacks_is_named():
    done = subprocess.run(
        [sys.executable, str(SCRIPTS), "run_fast"], capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
    assert "JaxPlan has no such script; it has run_gym, run_plan" in done.stderr


def test_a_planner_plays_in_gymnasium_s_loop(tmp_path):
    play = runpy.run_path(str(CLIENTS / "gymnasium_loop.py"))["play"]
    found = play(*tiny_files(tmp_path), epochs=50, seed=0)
    # a rate of 0.1 reaches the goal within some steps
    assert -2 * 0.5**2 - 0.2 <= found <= -2 * 0.5**2
