"""scikit-decide's JaxPlan solver with MDPO's planner; `make test-clients` has it installed."""

import runpy

import pytest
from helpers.problems import ROOT, tiny_files

import mdpo_rddl

pytest.importorskip("skdecide", reason="scikit-decide's pins differ: make test-clients")

CLIENT = ROOT / "examples" / "clients" / "scikit_decide_solver.py"
CONFIG = """
[Compiler]
method='DefaultJaxRDDLCompilerWithGrad'
print_warnings=False
[Planner]
method='JaxStraightLinePlan'
method_kwargs={}
optimizer='rmsprop'
optimizer_kwargs={'learning_rate': 0.1}
batch_size_train=8
pgpe=None
[Optimize]
key=42
epochs=100
train_seconds=1e300
print_summary=False
print_progress=False
"""
# only the first reward is lost, with both units half a unit from the goal
BEST = -2 * 0.5**2


@pytest.fixture
def client(monkeypatch):
    solvers = pytest.importorskip("skdecide.hub.solver.rddl.rddl")
    for name in ("JaxBackpropPlanner", "JaxOfflineController", "load_config"):
        monkeypatch.setattr(solvers, name, getattr(solvers, name))  # put back afterwards
    return runpy.run_path(str(CLIENT))


@pytest.mark.parametrize("noise", ["", "[Noise]\nmethod='NoNoise'\n"])
def test_its_solver_does_no_worse_with_our_planner(tmp_path, client, noise):
    config = tmp_path / "slp.cfg"
    config.write_text(CONFIG + noise)
    arguments = [*tiny_files(tmp_path), str(config)]
    theirs = client["play"](*arguments)
    client["use_mdpo"]()
    ours = client["play"](*arguments)
    assert ours[0] >= theirs[0] - 1e-6
    assert BEST - 0.05 <= ours[0] <= BEST
    if noise:
        assert ours == theirs


def test_the_case_that_scikit_decide_tests_itself(client, monkeypatch):
    """JaxPlan's configuration, JAX's simulator as the domain, and scikit-decide's own rollout."""
    import pyRDDLGym_jax.examples.configs as configs
    from pyRDDLGym_jax.core.simulator import JaxRDDLSimulator
    from skdecide.hub.domain.rddl import RDDLDomain
    from skdecide.utils import load_registered_solver, rollout

    planners = []

    class Counted(mdpo_rddl.MDPOPlanner):
        def __init__(self, *args, **kwargs):
            super().__init__(*args, **kwargs)
            planners.append(self)

    def make_domain():
        shown = {"display_with_pygame": False, "display_within_jupyter": False}
        name = "CartPole_Continuous_gym"
        return RDDLDomain(name, "0", backend=JaxRDDLSimulator, vectorized=True, **shown)

    monkeypatch.setattr(mdpo_rddl, "MDPOPlanner", Counted)
    client["pytest_configure"]()  # what `pytest -p scikit_decide_solver` calls
    config = f"{configs.__path__[0]}/Cartpole_Continuous_gym_drp.cfg"
    with load_registered_solver("RDDLJaxSolver")(make_domain, config=config) as solver:
        solver.solve()
        (episode,) = rollout(
            make_domain(), solver, max_steps=100, render=False, verbose=False, return_episodes=True
        )
    assert len(planners) == 1
    # the pole stands for as long as is played
    assert [value.reward for value in episode[2]] == [1.0] * 100
