"""The default: each of JaxPlan's updates as it is, and one with noise beside it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import make_plan, make_planner, optimize, tiny_files

from mdpo_rddl import MDPOPlanner, load_problem
from mdpo_rddl.noise import ConstantNoise, default_noise
from mdpo_rddl.planner.update.pairs import finite_test_loss, folded
from mdpo_rddl.planner.upstream import JaxBackpropPlanner
from mdpo_rddl.planner.upstream import planner as jaxplan


def trained(planner_class, folder, **arguments):
    problem = load_problem(*tiny_files(folder, spread=0.2))
    planner = make_planner(planner_class, problem, make_plan("slp"), **arguments)
    callbacks = planner.optimize_generator(
        key=jax.random.PRNGKey(3), epochs=6, print_summary=False, print_progress=False
    )
    return planner, list(callbacks)


@pytest.mark.parametrize("updates", [1, 2])
def test_the_best_is_at_least_jaxplans_and_the_shapes_are_its_own(tmp_path, updates):
    _, theirs = trained(JaxBackpropPlanner, tmp_path, parallel_updates=updates)
    planner, ours = trained(MDPOPlanner, tmp_path, parallel_updates=updates)
    assert planner.parallel_updates == 2 * updates
    for mine, other in zip(ours, theirs, strict=True):
        assert np.all(np.asarray(mine["test_return"]) >= other["test_return"] - 1e-5)
        assert mine["best_return"] >= other["best_return"] - 1e-5
        assert 0 <= mine["best_index"] < updates
        for name in ("params", "best_params", "train_return", "grad", "train_log", "test_log"):
            shapes = [jax.tree.map(jnp.shape, found[name]) for found in (mine, other)]
            common = {key: shapes[0][key] for key in shapes[1]} if name == "train_log" else None
            assert (common or shapes[0]) == shapes[1]
        assert mine["sigma"].shape == (updates, 4)


def test_jaxplans_own_updates_are_among_the_lanes(tmp_path):
    problem = load_problem(*tiny_files(tmp_path, spread=0.2))
    theirs = optimize(make_planner(JaxBackpropPlanner, problem, make_plan("slp")), 6)
    planner = make_planner(MDPOPlanner, problem, make_plan("slp"), noise=default_noise())
    lanes = []
    update = planner.update

    def watched(*arguments):
        result = update(*arguments)
        lanes.append(jax.tree.map(np.asarray, result[0]))
        return result

    planner.update = watched
    optimize(planner, 6)
    np.testing.assert_allclose(lanes[-1]["push"][0], theirs["params"]["push"][0], rtol=1e-5)
    assert lanes[-1]["push"].shape[0] == 2
    assert not np.allclose(lanes[-1]["push"][1], lanes[-1]["push"][0])


class Noting(jaxplan.NoImprovementStoppingRule):
    """Stops after one iteration without a gain, and keeps what it was shown."""

    def __init__(self):
        super().__init__(patience=1)
        self.seen = []

    def monitor(self, callback):
        self.seen.append(callback)
        return super().monitor(callback)


@pytest.mark.parametrize("updates", [1, 2])
def test_a_stopping_rule_watches_jaxplans_own_updates(tmp_path, updates):
    problem = load_problem(*tiny_files(tmp_path, spread=0.2))
    rules = []
    for planner_class in (JaxBackpropPlanner, MDPOPlanner):
        plan, rule = make_plan("slp"), Noting()
        planner = make_planner(planner_class, problem, plan, parallel_updates=updates)
        callback = optimize(planner, 60, stopping_rule=rule)
        rules.append((rule, callback["iteration"]))
    (theirs, their_last), (ours, our_last) = rules
    assert our_last == their_last < 59
    for mine, other in zip(ours.seen, theirs.seen, strict=True):
        assert mine["best_index"] == other["best_index"]
        np.testing.assert_allclose(mine["best_return"], other["best_return"], rtol=1e-4)
        np.testing.assert_allclose(mine["test_return"], other["test_return"], rtol=1e-4)
        np.testing.assert_allclose(
            mine["params"]["push"], other["params"]["push"], rtol=1e-3, atol=1e-6
        )


def test_a_silent_rule_has_no_companions(tmp_path):
    silent = ConstantNoise(0.0, paired=True)
    planner, callbacks = trained(MDPOPlanner, tmp_path, noise=silent)
    assert planner.parallel_updates == planner.restarts == 1
    assert callbacks[-1]["test_return"].shape == (1,)


def test_a_lane_that_diverged_does_not_hide_the_others():
    losses = jnp.array([2.0, jnp.nan, -5.0, jnp.inf])
    test_loss = finite_test_loss(lambda losses: (losses, "log"))
    found, log = test_loss(losses)
    assert log == "log"
    np.testing.assert_allclose(found, [2.0, 6000.0, -5.0, 6000.0])
    assert np.all(np.isnan(test_loss(jnp.full(2, jnp.nan))[0]))


def test_each_pair_shows_the_lane_with_the_better_test_return():
    # pairs: lanes 0 and 3, 1 and 4, 2 and 5
    returns = np.array([1.0, 5.0, np.nan, 2.0, 5.0, -7.0])
    params = {"p": jnp.arange(6.0)}
    callback = {"test_return": returns, "params": params, "best_index": 4, "pgpe_params": None}
    entries = folded(callback)
    np.testing.assert_array_equal(entries["params"]["p"], [3.0, 1.0, 5.0])
    np.testing.assert_array_equal(entries["test_return"], [2.0, 5.0, -7.0])
    assert entries["best_index"] == 1
    assert set(entries) == {"test_return", "params", "best_index"}
