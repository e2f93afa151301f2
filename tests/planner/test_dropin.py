"""What works with JaxPlan 3.1 works with one import changed: scripts, controllers, options."""

import inspect
import runpy

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import (
    FOREVER,
    JAXPLAN_EXAMPLES,
    assert_same_bits,
    make_plan,
    make_planner,
    optimize,
    tiny_files,
)
from pyRDDLGym.core.env import RDDLEnv
from pyRDDLGym.core.policy import BaseAgent

from mdpo_rddl import (
    AdaptiveNoise,
    ConstantNoise,
    JaxOnlineController,
    MDPOPlanner,
    NoNoise,
    load_config,
    load_config_from_string,
)
from mdpo_rddl.planner.upstream import JaxBackpropPlanner
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


# --- JaxPlan's example scripts, with their import changed ------------------------------------

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

[Optimize]
key=42
epochs=4
train_seconds=1e300
policy_hyperparams=1.0
print_summary=False
print_progress=False

[Noise]
method={noise!r}
"""
METHODS = {
    "slp": "JaxStraightLinePlan",
    "drp": "JaxDeepReactivePolicy",
    "replan": "JaxStraightLinePlan",
}


@pytest.fixture
def played(monkeypatch):
    """What every evaluation returned."""
    results = []
    evaluate = BaseAgent.evaluate
    monkeypatch.setattr(BaseAgent, "evaluate", lambda *a, **k: results.append(evaluate(*a, **k)))
    monkeypatch.setattr(RDDLEnv, "render", lambda *a, **k: None)
    return results


def example_main(folder, name, changed):
    """The function `main` of one of JaxPlan's examples."""
    text = (JAXPLAN_EXAMPLES / name).read_text()
    if changed:
        theirs = "from pyRDDLGym_jax.core.planner import "
        assert text.count(theirs) == 1
        text = text.replace(theirs, "from mdpo_rddl import ")
        text = text.replace("JaxBackpropPlanner, ", "MDPOPlanner as JaxBackpropPlanner, ", 1)
    script = folder / name
    script.write_text(text)
    module = runpy.run_path(str(script))
    assert module["JaxBackpropPlanner"] is (MDPOPlanner if changed else JaxBackpropPlanner)
    return module["main"]


@pytest.mark.parametrize("method", METHODS)
def test_jaxplan_s_script_plays_the_same_episode(tmp_path, played, method):
    files = tiny_files(tmp_path)
    (tmp_path / "configs").mkdir()
    config = tmp_path / "configs" / f"default_{method}.cfg"
    runs = [("NoNoise", False), ("NoNoise", True)]
    if method == "slp":
        runs.append(("ConstantNoise", True))
    for noise, changed in runs:
        # JaxPlan reads the file with [Noise] too
        config.write_text(CONFIG.format(method=METHODS[method], noise=noise))
        example_main(tmp_path, "run_plan.py", changed)(*files, method)
    theirs, ours, *noisy = played
    assert ours == theirs
    assert all(result["mean"] != theirs["mean"] for result in noisy)


def test_jaxplan_s_scipy_script_finds_the_optimum(tmp_path, played):
    files = tiny_files(tmp_path)
    (tmp_path / "configs").mkdir()
    config = tmp_path / "configs" / "default_slp.cfg"
    config.write_text(CONFIG.format(method=METHODS["slp"], noise="AdaptiveNoise"))
    example_main(tmp_path, "run_scipy.py", True)(*files, "BFGS")
    # both units are at the goal after the first action: only the first reward is lost
    assert played[0]["mean"] == pytest.approx(-2 * 0.5**2, abs=1e-4)


def test_the_optimization_problem_is_jaxplan_s_whatever_the_noise(windy):
    problems = [
        make_planner(planner_class, windy, make_plan("drp"), **extra).as_optimization_problem(
            key=jax.random.PRNGKey(5)
        )
        for planner_class, extra in (
            (JaxBackpropPlanner, {}),
            (MDPOPlanner, {"noise": ConstantNoise(3.0)}),
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
        with jax.enable_x64(True):
            yield
    finally:
        jax.config.update("jax_enable_x64", False)


def test_64_bit(windy, in_64_bit):
    compiler = {"use64bit": True, "print_warnings": False}
    noisy = trained(MDPOPlanner, windy, noise=AdaptiveNoise(), compiler_kwargs=compiler)
    leaves = [*jax.tree.leaves(noisy["params"]), noisy["sigma"], noisy["sensitivity"]]
    assert {np.asarray(leaf).dtype for leaf in leaves} == {np.dtype(np.float64)}
