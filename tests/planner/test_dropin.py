"""What works with JaxPlan 3.1 works with one import changed: scripts, controllers, options."""

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import (
    FOREVER,
    assert_same_bits,
    make_plan,
    make_planner,
    optimize,
    tiny_files,
)
from helpers.toys import toy
from helpers.x64 import enable_x64

from mdpo_rddl import (
    AdaptiveNoise,
    ConstantNoise,
    JaxOnlineController,
    MDPOPlanner,
    NoNoise,
    load_config,
    load_config_from_string,
)
from mdpo_rddl.planner.upstream import GaussianPGPE, JaxBackpropPlanner
from mdpo_rddl.planner.upstream import planner as jaxplan
from mdpo_rddl.problem.load import load_problem, make_environment

SILENT = {"print_summary": False, "print_progress": False}


def assert_close(ours, theirs):
    # the order of summation over a batch of rollouts may differ
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-5), ours, theirs)


@pytest.fixture
def tiny(tmp_path):
    return load_problem(*tiny_files(tmp_path))


@pytest.fixture
def windy(tmp_path):
    return load_problem(*tiny_files(tmp_path, spread=0.3))


# runs the code for noise, whose effect is below the precision
WHISPER = AdaptiveNoise(0.0, 1e-30)


def trained(planner_class, problem, kind="slp", epochs=5, training=None, **arguments):
    """The last callback."""
    planner = make_planner(planner_class, problem, make_plan(kind), **arguments)
    return optimize(planner, epochs, train_seconds=FOREVER, **(training or {}))


@pytest.mark.parametrize("noise", [None, ConstantNoise(3.0)])
def test_the_optimization_problem_is_jaxplan_s_whatever_the_noise(windy, noise):
    problems = [
        make_planner(planner_class, windy, make_plan("drp"), **extra).as_optimization_problem(
            key=jax.random.PRNGKey(5)
        )
        for planner_class, extra in (
            (JaxBackpropPlanner, {}),
            (MDPOPlanner, {"noise": noise}),
        )
    ]
    (loss, grad, guess, unravel), (our_loss, our_grad, our_guess, our_unravel) = problems
    np.testing.assert_array_equal(our_guess, guess)
    assert our_loss(guess) == loss(guess)
    np.testing.assert_array_equal(our_grad(guess), grad(guess))
    assert_same_bits(our_unravel(guess), unravel(guess))


def test_signatures_are_jaxplan_s():
    for name in ("optimize", "optimize_generator", "get_action", "as_optimization_problem"):
        ours, theirs = (
            inspect.signature(getattr(cls, name)) for cls in (MDPOPlanner, JaxBackpropPlanner)
        )
        assert [(p.name, p.default, p.kind) for p in ours.parameters.values()] == [
            (p.name, p.default, p.kind) for p in theirs.parameters.values()
        ]
    for ours, theirs in (
        (load_config, jaxplan.load_config),
        (load_config_from_string, jaxplan.load_config_from_string),
    ):
        assert list(inspect.signature(ours).parameters) == list(
            inspect.signature(theirs).parameters
        )


def test_arguments_may_be_given_by_position(tiny):
    positional = MDPOPlanner(tiny.model, make_plan("slp"), 3, 2, 4, 2, pgpe=None)
    assert (positional.batch_size_train, positional.batch_size_test) == (3, 2)
    # beside each of the two is one with noise
    assert (positional.horizon, positional.parallel_updates) == (4, 2 * 2)
    key = jax.random.PRNGKey(0)
    by_position = list(positional.optimize_generator(key, 3, FOREVER, **SILENT))
    by_name = list(
        positional.optimize_generator(key=key, epochs=3, train_seconds=FOREVER, **SILENT)
    )
    assert len(by_position) == 3
    assert_same_bits(by_position[-1]["params"], by_name[-1]["params"])
    assert by_name[-1]["sigma"].shape == by_name[-1]["sensitivity"].shape == (2, 4)


class OwnPlan(jaxplan.JaxPlan):
    """A straight-line plan that tells nobody its bounds."""

    def compile(self, compiled, _bounds, horizon, preprocessor=None):
        shape = (horizon, *np.shape(compiled.init_values["push"]))
        self.projection = lambda params, hyperparams: (params, jnp.array(True))
        self.initializer = lambda key, hyperparams, fluents: {"w": jax.random.normal(key, shape)}
        self.train_policy = lambda key, params, hyperparams, step, fluents, history: {
            "push": params["w"][step]
        }
        self.test_policy = lambda *arguments: {
            "push": jnp.clip(self.train_policy(*arguments)["push"], -1.0, 1.0)
        }

    def guess_next_epoch(self, params):
        return params


@pytest.mark.long
def test_a_plan_of_one_s_own_trains_to_jaxplan_s_bits(windy):
    theirs, ours = (
        optimize(make_planner(planner_class, windy, OwnPlan(), **extra), 3)
        for planner_class, extra in (
            (JaxBackpropPlanner, {}),
            (MDPOPlanner, {"noise": NoNoise()}),
        )
    )
    assert_same_bits(ours["params"], theirs["params"])


def test_noise_on_a_plan_of_one_s_own_keeps_to_the_boxes(windy):
    box = np.full(2, -1.0), np.array([1.0, 0.25])
    arguments = {"noise": ConstantNoise(0.5), "action_bounds": {"push": box}}
    planner = make_planner(MDPOPlanner, windy, OwnPlan(), **arguments)
    spec = planner.action_specs["push"]
    assert (spec.lower.tolist(), spec.upper.tolist()) == ([-1.0, -1.0], [1.0, 0.25])
    assert np.all(np.isfinite(optimize(planner, 2)["params"]["w"]))


# --- iterations and keys ---------------------------------------------------------------------


def test_a_single_iteration_is_the_first_of_several(tiny):
    """JaxPlan divides by the number of iterations less one."""
    planner = make_planner(MDPOPlanner, tiny, make_plan("slp"))
    key = jax.random.PRNGKey(1)
    first, *_ = planner.optimize_generator(key=key, epochs=3, **SILENT)
    callbacks = list(planner.optimize_generator(key=key, epochs=1, **SILENT))
    assert len(callbacks) == 1
    assert_same_bits(callbacks[0]["params"], first["params"])
    assert callbacks[0]["status"] is jaxplan.JaxPlannerStatus.ITER_BUDGET_REACHED
    assert callbacks[0]["progress"] == 100


def test_the_key_decides_everything_but_the_clock(windy):
    planner = make_planner(MDPOPlanner, windy, make_plan("slp"), noise=AdaptiveNoise())
    one, again, other = (
        optimize(planner, 4, seed=seed, train_seconds=FOREVER) for seed in (1, 1, 2)
    )
    for name in ("params", "sigma", "sensitivity", "train_return"):
        assert_same_bits(one[name], again[name])
        different = zip(jax.tree.leaves(one[name]), jax.tree.leaves(other[name]), strict=True)
        assert any(np.any(a != b) for a, b in different), name


# --- JaxPlan's options -----------------------------------------------------------------------


@pytest.mark.long
def test_pgpe_trains_groups_of_bools_with_parallel_updates():
    """With several, the flags of convergence of JaxPlan's two halves have different shapes."""
    pgpe = {"pgpe": GaussianPGPE(batch_size=2), "parallel_updates": 2}
    found = trained(MDPOPlanner, toy("quest"), epochs=3, noise=NoNoise(), **pgpe)
    assert found["pgpe_return"].shape == (2,)
    assert np.isfinite(found["best_return"])


def test_a_critic_answers_to_the_last_action(windy):
    def critic(params, state, action):
        return params * jnp.sum(state["x"])

    noisy = trained(
        MDPOPlanner, windy, noise=WHISPER, critic=critic, training={"critic_params": 3.0}
    )
    # nothing but the critic answers to the last action: with 3 for each of the two units, whose
    # range is 2 wide
    assert noisy["sensitivity"][0, -1] == pytest.approx(2.0 * 3.0 * np.sqrt(2.0), rel=1e-5)
    alone = trained(MDPOPlanner, windy, noise=WHISPER)
    assert alone["sensitivity"][0, -1] == 0.0


@pytest.mark.long
def test_the_sensitivity_is_the_mean_return_s_whatever_is_optimised(windy):
    arguments = {"batch_size_train": 8, "utility": "cvar", "utility_kwargs": {"alpha": 0.5}}
    first, mean = (
        next(
            make_planner(MDPOPlanner, windy, make_plan("slp"), **extra).optimize_generator(
                key=jax.random.PRNGKey(3), epochs=2, **SILENT
            )
        )
        for extra in (
            {"noise": AdaptiveNoise(), **arguments},
            {"noise": AdaptiveNoise(), "batch_size_train": 8},
        )
    )
    assert np.any(first["sensitivity"] > 0.0)
    assert_same_bits(first["sensitivity"], mean["sensitivity"])
    assert np.all(first["train_return"] < mean["train_return"])


@pytest.mark.long
def test_partially_observed_problem():
    problem = load_problem("SysAdmin_POMDP_ippc2011", "1", 3)
    planners = [
        make_planner(planner_class, problem, make_plan("drp"), batch_size_train=2, **extra)
        for planner_class, extra in (
            (JaxBackpropPlanner, {}),
            (MDPOPlanner, {"noise": NoNoise()}),
            (MDPOPlanner, {"noise": WHISPER}),
        )
    ]
    theirs, ours, quiet = (optimize(planner, 3) for planner in planners)
    assert_same_bits(ours["params"], theirs["params"])
    assert_close(quiet["params"], theirs["params"])
    assert np.any(quiet["sensitivity"] > 0.0)
    # replanned from what is observed at each step
    played, last = [], []
    for planner in planners[:2]:
        agent = JaxOnlineController(planner, key=jax.random.PRNGKey(0), epochs=3, **SILENT)
        played.append(agent.evaluate(make_environment(problem), episodes=1, seed=0))
        last.append(agent.callback["params"])
    assert played[0] == played[1]
    assert_same_bits(*last)


@pytest.fixture
def in_64_bit():
    """JaxPlan switches 64 bit on for the whole process."""
    try:
        with enable_x64(True):
            yield
    finally:
        jax.config.update("jax_enable_x64", False)


def test_64_bit(windy, in_64_bit):
    compiler = {"use64bit": True, "print_warnings": False}
    noisy = trained(MDPOPlanner, windy, noise=AdaptiveNoise(), compiler_kwargs=compiler)
    leaves = [*jax.tree.leaves(noisy["params"]), noisy["sigma"], noisy["sensitivity"]]
    assert {np.asarray(leaf).dtype for leaf in leaves} == {np.dtype(np.float64)}
