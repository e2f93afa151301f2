"""JaxPlan's dashboard over MDPO: what it is told, and that the real one can show it."""

import jax
import numpy as np
import pytest
from helpers.problems import make_plan, make_planner, optimize, tiny_files

from mdpo_rddl import ConstantNoise, MDPOPlanner, load_config_from_string, load_problem
from mdpo_rddl.planner.upstream import planner as jaxplan


class Recorder:
    """Stands in for `JaxPlannerDashboard`."""

    def __init__(self):
        self.registered, self.updates = [], []

    @staticmethod
    def get_planner_info(planner):
        return planner

    def register_experiment(self, experiment_id, info, key=None, viz=None):
        self.registered.append((experiment_id, info, key, viz))
        return experiment_id

    def update_experiment(self, experiment_id, callback):
        self.updates.append((experiment_id, callback))


@pytest.fixture
def problem(tmp_path):
    return load_problem(*tiny_files(tmp_path, horizon=3, spread=0.2))


def test_the_dashboard_is_told_of_every_iteration_and_sees_the_noise_in_it(problem):
    dashboard, viz = Recorder(), object()
    planner = make_planner(
        MDPOPlanner,
        problem,
        make_plan("slp"),
        noise=ConstantNoise(0.5, "absolute"),
        parallel_updates=2,
        dashboard=dashboard,
        dashboard_viz=viz,
    )
    optimize(planner, 3, seed=7, dashboard_id="run")
    assert dashboard.registered == [("run", planner, int(jax.random.PRNGKey(7)[1]), viz)]
    assert [name for name, _ in dashboard.updates] == ["run"] * 3
    assert [callback["iteration"] for _, callback in dashboard.updates] == [0, 1, 2]
    for _, callback in dashboard.updates:
        log = callback["train_log"]
        np.testing.assert_array_equal(log["sigma"], np.full((2, 3), 0.5))
        # the perturbed rollouts' own paths: one unit of push is one unit of way, plus the wind
        x, push = log["fluents"]["x"], log["fluents"]["push"]
        assert x.shape == push.shape == (2, 1, 3, 2)
        assert np.all(np.abs(push) <= 1.0)
        assert len(np.unique(push)) > 2, "the dashboard is shown the plan without its noise"
        np.testing.assert_allclose(log["reward"][..., 1:], -rest(x), rtol=1e-4, atol=1e-5)


def test_without_a_rule_the_dashboard_is_told_what_is_shown(problem):
    dashboard = Recorder()
    planner = make_planner(MDPOPlanner, problem, make_plan("slp"), dashboard=dashboard)
    last = optimize(planner, 4)
    for _, callback in dashboard.updates:
        assert callback["test_return"].shape == (1,)
        assert callback["test_log"]["fluents"]["push"].shape[0] == 1
    assert dashboard.updates[-1][1] is last


def rest(x):
    """The cost of all states but the first, which no action has reached."""
    return np.sum((np.asarray(x)[..., :-1, :] - 0.5) ** 2, axis=-1)


def test_the_real_dashboard_shows_a_run(problem):
    pytest.importorskip("dash")
    pytest.importorskip("dash_bootstrap_components")
    dashboard = jaxplan.JaxPlannerDashboard()
    planner = make_planner(MDPOPlanner, problem, make_plan("slp"), dashboard=dashboard)
    callback = optimize(planner, 5, dashboard_id="run", train_seconds=1e300)
    assert dashboard.progress == {"run": 100}
    assert dashboard.status == {"run": "ITER_BUDGET_REACHED"}
    assert dashboard.train_return["run"][-1] == callback["train_return"][0]
    np.testing.assert_array_equal(
        dashboard.action_output["run"]["push"], callback["test_log"]["fluents"]["push"][0]
    )
    np.testing.assert_array_equal(
        dashboard.train_state_output["run"]["x"], callback["train_log"]["fluents"]["x"][0]
    )


def test_a_configuration_asks_for_the_dashboard():
    text = "[Compiler]\n[Planner]\nmethod='JaxStraightLinePlan'\ndashboard=True\n[Optimize]\n"
    planner_args, _, _ = load_config_from_string(text)
    if jaxplan.JaxPlannerDashboard is None:
        assert "dashboard" not in planner_args
    else:
        assert isinstance(planner_args["dashboard"], jaxplan.JaxPlannerDashboard)
