"""The default: each of JaxPlan's updates as it is, and one with noise beside it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import FOREVER, make_plan, make_planner, optimize, tiny_files

from mdpo_rddl import MDPOPlanner, load_problem
from mdpo_rddl.noise import ConstantNoise, NoNoise, default_noise
from mdpo_rddl.planner.update.pairs import finite_test_loss, folded
from mdpo_rddl.planner.update.plain_rule import PlainUpdatesRule
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


SHOWN = (
    "test_return",
    "train_return",
    "best_return",
    "best_index",
    "last_iteration_improved",
    "params",
    "best_params",
    "grad",
    "best_grad",
)
OF_PGPE = ("pgpe_return", "pgpe_improved", "pgpe_params")


class Noting(jaxplan.NoImprovementStoppingRule):
    """Stops after some iterations without a gain, and keeps what it was shown."""

    def __init__(self, patience=1):
        super().__init__(patience=patience)
        self.seen = []

    def monitor(self, callback):
        self.seen.append(callback)
        return super().monitor(callback)


def watched(planner_class, folder, patience=1, **arguments):
    problem = load_problem(*tiny_files(folder, spread=0.2))
    planner = make_planner(planner_class, problem, make_plan("slp"), **arguments)
    rule = Noting(patience)
    optimize(planner, 60, stopping_rule=rule, train_seconds=FOREVER)
    return rule.seen


def assert_shown(ours, theirs, names=SHOWN):
    assert len(ours) == len(theirs)
    for mine, other in zip(ours, theirs, strict=True):
        for name in ("iteration", *names):
            for one, two in zip(*map(jax.tree.leaves, (mine[name], other[name])), strict=True):
                np.testing.assert_allclose(one, two, rtol=1e-3, atol=1e-5, err_msg=name)


@pytest.mark.parametrize("updates", [1, 2])
def test_a_stopping_rule_watches_jaxplans_own_updates(tmp_path, updates):
    theirs = watched(JaxBackpropPlanner, tmp_path, patience=4, parallel_updates=updates)
    ours = watched(MDPOPlanner, tmp_path, patience=4, parallel_updates=updates)
    assert len(theirs) < 60
    # without a gain, so that what is kept of an earlier iteration shows
    assert theirs[-1]["last_iteration_improved"] == theirs[-1]["iteration"] - 4
    assert_shown(ours, theirs)


@pytest.mark.long
def test_a_stopping_rule_watches_jaxplans_own_pgpe(tmp_path):
    found = []
    for planner_class in (JaxBackpropPlanner, MDPOPlanner):
        pgpe = jaxplan.GaussianPGPE(optimizer_kwargs_mu={"learning_rate": 0.05})
        found.append(watched(planner_class, tmp_path, patience=60, pgpe=pgpe))
    theirs, ours = found
    assert 0 < sum(callback["pgpe_improved"] for callback in theirs) < 60
    assert_shown(ours, theirs, (*SHOWN, *OF_PGPE))


@pytest.mark.long
@pytest.mark.parametrize("updates", [1, 2])
def test_a_stopping_rule_watches_what_calls_without_noise_tell(tmp_path, updates):
    calls = {"parallel_updates": updates, "iterations_per_call": 10, "test_every": 1}
    theirs = watched(MDPOPlanner, tmp_path, patience=60, noise=NoNoise(), **calls)
    ours = watched(MDPOPlanner, tmp_path, patience=60, **calls)
    bests = [callback["best_return"] for callback in theirs]
    # the best test is not the last one of a call, which is all that the returns tell
    assert any(np.max(c["test_return"]) < c["best_return"] for c in theirs)
    assert bests == sorted(bests)
    assert_shown(ours, theirs)


def test_pgpe_improves_where_it_undercuts_jaxplans_own_update():
    rule = Noting(patience=9)
    plain = PlainUpdatesRule(rule)
    plain.reset()
    zeros = {"params": {"p": np.zeros(2)}, "grad": {"p": np.zeros(2)}, "train_return": np.ones(2)}
    # one pair: the companion's PGPE always improves, JaxPlan's where it is ahead of all before
    for iteration, (tested, found) in enumerate([(1.0, 1.0), (3.0, 0.5), (3.0, 3.0), (4.0, 4.0)]):
        returns = {"test_return": np.array([tested, 9.0]), "pgpe_return": np.array([found, 9.0])}
        plain.monitor({**zeros, **returns, "iteration": iteration, "pgpe_improved": True})
    assert [seen["pgpe_improved"] for seen in rule.seen] == [True, False, False, True]
    assert [seen["last_iteration_improved"] for seen in rule.seen] == [0, 1, 1, 3]
    assert [seen["best_return"] for seen in rule.seen] == [1.0, 3.0, 3.0, 4.0]


def test_a_silent_rule_has_no_companions(tmp_path):
    silent = ConstantNoise(0.0, paired=True)
    planner, callbacks = trained(MDPOPlanner, tmp_path, noise=silent)
    assert planner.parallel_updates == planner.restarts == 1
    assert callbacks[-1]["test_return"].shape == (1,)


def test_a_lane_that_diverged_does_not_hide_the_others():
    losses = jnp.array([2.0, jnp.nan, -5.0, jnp.inf])
    test_loss = finite_test_loss(lambda losses, params: (losses, "log"))
    params = jnp.zeros(4)
    found, log = test_loss(losses, params)
    assert log == "log"
    np.testing.assert_allclose(found, [2.0, 6000.0, -5.0, 6000.0])
    assert np.all(np.isnan(test_loss(jnp.full(4, jnp.nan), params)[0]))
    # nor one whose parameters are no numbers
    lost = jnp.array([0.0, 0.0, jnp.nan, 0.0])
    np.testing.assert_allclose(test_loss(losses, lost)[0], [2.0, 3000.0, 3000.0, 3000.0])


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
