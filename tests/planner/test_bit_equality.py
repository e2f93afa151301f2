"""Without noise MDPO trains to JaxPlan's own bits: a table of what can be set, each with both."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import (
    FOREVER,
    JAXPLAN_EXAMPLES,
    TINY_DOMAIN,
    TINY_INSTANCE,
    assert_same_bits,
    make_plan,
    make_planner,
    shipped,
)
from helpers.toys import problem_from
from helpers.x64 import enable_x64

from mdpo_rddl import MDPOPlanner, load_config, load_problem
from mdpo_rddl.noise import ActionNoise, AdaptiveNoise, ConstantNoise, NoNoise
from mdpo_rddl.planner.upstream import JaxBackpropPlanner
from mdpo_rddl.planner.upstream import planner as jaxplan
from mdpo_rddl.problem.load import Problem

SILENT = {"train_seconds": FOREVER, "print_summary": False, "print_progress": False}
KEY = jax.random.PRNGKey(3)
# runs the code for noise, whose effect is below the precision
WHISPER = AdaptiveNoise(0.0, 1e-30)


class Ends(NamedTuple):
    """The callbacks of the first iteration and of the last."""

    first: dict[str, Any]
    last: dict[str, Any]


Run = Callable[..., Ends]


def ends(callbacks: Any) -> Ends:
    first, *_, last = callbacks
    return Ends(first, last)


def direct(problem: Callable[[], Problem], kind: str, **arguments: Any) -> Run:
    """A planner made by hand; `epochs` and `training` go to `optimize`."""
    epochs, training = arguments.pop("epochs", 6), arguments.pop("training", {})

    def run(planner_class: type, **extra: Any) -> Ends:
        planner = make_planner(planner_class, problem(), make_plan(kind), **arguments, **extra)
        return ends(planner.optimize_generator(key=KEY, epochs=epochs, **SILENT, **training))

    return run


def in_64_bit(run: Run) -> Run:
    """JaxPlan switches 64 bit on for the whole process."""

    def wide(planner_class: type, **extra: Any) -> Ends:
        try:
            with enable_x64(True):
                return run(planner_class, **extra)
        finally:
            jax.config.update("jax_enable_x64", False)

    return wide


def configured(config: str, domain: str, instance: str) -> Run:
    """One of JaxPlan's own configurations, with a short horizon and a small batch."""

    def run(planner_class: type, **extra: Any) -> Ends:
        load = load_config if planner_class is MDPOPlanner else jaxplan.load_config
        planner_args, _, train_args = load(str(JAXPLAN_EXAMPLES / "configs" / f"{config}.cfg"))
        planner_args |= {"batch_size_train": 2, "batch_size_test": 2, **extra}
        if planner_args.get("rollout_horizon", 0) > 5:
            planner_args["rollout_horizon"] = 5
        planner_args["compiler_kwargs"]["print_warnings"] = False
        problem = load_problem(domain, instance, horizon=4)
        planner = planner_class(rddl=problem.model, **planner_args)
        return ends(planner.optimize_generator(**train_args | SILENT | {"epochs": 5}))

    return run


def critic(params: Any, state: Any, action: Any) -> Any:
    return params * jnp.sum(state["x"])


def windy() -> Problem:
    instance = TINY_INSTANCE.replace("_HORIZON", "4").replace("_SPREAD", "0.3")
    return problem_from(TINY_DOMAIN + instance)


BOUNDS = {"x": (np.full(2, -2.0), np.full(2, 3.0))}
WIDE = {"use64bit": True, "print_warnings": False}
UTILITIES = {"mean_var": {"beta": 0.5}, "cvar": {"alpha": 0.5}, "entropic": {"beta": 0.5}}
CONSTANT, ADAPTIVE = ConstantNoise(0.0), AdaptiveNoise(0.0, 0.0)

# per case how to train, and a rule that never perturbs
CASES: dict[str, tuple[Run, ActionNoise]] = {
    "drp": (direct(lambda: shipped("hvac10", 30), "drp"), NoNoise()),
    "slp, batch": (
        direct(lambda: shipped("hvac10", 30), "slp", batch_size_train=3),
        CONSTANT,
    ),
    "restarts": (
        direct(lambda: shipped("powergen7", 30), "drp", parallel_updates=2, batch_size_train=2),
        ADAPTIVE,
    ),
    "clipping and averaging": (
        direct(
            lambda: shipped("reservoir15", 30),
            "slp",
            parallel_updates=2,
            clip_grad=1.0,
            ema_decay=0.9,
        ),
        NoNoise(),
    ),
    "preprocessor": (
        direct(windy, "drp", preprocessor=jaxplan.StaticNormalizer(BOUNDS)),
        NoNoise(),
    ),
    "critic": (
        direct(windy, "slp", critic=critic, training={"critic_params": 3.0}),
        NoNoise(),
    ),
    "64 bit": (in_64_bit(direct(windy, "slp", compiler_kwargs=WIDE)), NoNoise()),
    **{
        utility: (
            direct(
                windy,
                "slp",
                epochs=3,
                batch_size_train=8,
                utility=utility,
                utility_kwargs=parameters,
            ),
            NoNoise(),
        )
        for utility, parameters in UTILITIES.items()
    },
}
# Every kind among JaxPlan's examples: slp, drp and replan; real and bool; with and without PGPE,
# clipping, policy hyperparameters as a number and as a dictionary. Of the same kinds, and left
# out for their compile time: HVAC, MountainCar, Quadcopter, Reservoir, UAV, the other files of
# Cartpole, PowerGen, Wildfire and default.
CONFIGS = {
    "Cartpole_Continuous_gym_drp": ("CartPole_Continuous_gym", "0"),
    "Cartpole_Continuous_gym_slp": ("CartPole_Continuous_gym", "0"),
    "PowerGen_Continuous_drp": ("PowerGen_Continuous", "0"),
    "PowerGen_Continuous_replan": ("PowerGen_Continuous", "0"),
    "Wildfire_MDP_ippc2014_drp": ("Wildfire_MDP_ippc2014", "1"),
    "Wildfire_MDP_ippc2014_slp": ("Wildfire_MDP_ippc2014", "1"),
    "default_replan": ("CartPole_Continuous_gym", "0"),
}
QUICK_CONFIGS = {"PowerGen_Continuous_replan", "Wildfire_MDP_ippc2014_slp", "default_replan"}
CASES |= {name: (configured(name, *problem), NoNoise()) for name, problem in CONFIGS.items()}
# others of their kind are quicker
LONG = {
    *("slp, batch", "clipping and averaging", "cvar", "entropic"),
    *("default_replan", "Wildfire_MDP_ippc2014_slp", "restarts", "critic", "mean_var"),
}
QUIET = ["restarts", "preprocessor", "critic"]


@functools.cache
def jaxplan_s(name: str) -> Ends:
    """What JaxPlan's own planner comes to, trained once."""
    run, _ = CASES[name]
    return run(JaxBackpropPlanner)


def marked(name: str) -> Any:
    is_slow = name in CONFIGS.keys() - QUICK_CONFIGS
    is_long = name in LONG
    marks = pytest.mark.slow if is_slow else pytest.mark.long if is_long else []
    return pytest.param(name, marks=marks)


@pytest.mark.parametrize("name", [marked(name) for name in CASES])
def test_without_noise_every_bit_is_jaxplan_s(name):
    run, silent = CASES[name]
    theirs, ours = jaxplan_s(name).last, run(MDPOPlanner, noise=silent).last
    assert set(ours) == set(theirs) | {"sigma", "sensitivity"}
    for key in ("params", "best_params", "pgpe_params", "train_return", "test_return", "grad"):
        assert_same_bits(ours[key], theirs[key])
    assert ours["status"] is theirs["status"]
    assert not np.any(ours["sigma"])


@pytest.mark.parametrize("name", [marked(name) for name in QUIET])
def test_vanishing_noise_vanishes_in_the_perturbed_rollouts_too(name):
    run, _ = CASES[name]
    theirs, ours = jaxplan_s(name).first, run(MDPOPlanner, noise=WHISPER).first
    np.testing.assert_allclose(ours["train_return"], theirs["train_return"], rtol=1e-6)
    # the order of summation over a batch of rollouts may differ
    largest = max(np.abs(leaf).max() for leaf in jax.tree.leaves(theirs["grad"]))
    assert largest > 0.0
    for mine, other in zip(*map(jax.tree.leaves, (ours["grad"], theirs["grad"])), strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-4, atol=1e-5 * largest)


@pytest.mark.long
def test_pgpe_by_default_is_jaxplan_s_but_not_shared():
    problem = windy()
    arguments = {"batch_size_train": 2, "compiler_kwargs": {"print_warnings": False}}
    ours, other = (
        MDPOPlanner(problem.model, make_plan("slp"), noise=NoNoise(), **arguments) for _ in range(2)
    )
    assert ours.pgpe is not other.pgpe
    theirs = JaxBackpropPlanner(problem.model, make_plan("slp"), **arguments)
    # of two of JaxPlan's, the first could not train once the second is made
    one, expected = (planner.optimize(key=KEY, epochs=5, **SILENT) for planner in (ours, theirs))
    assert_same_bits(one["params"], expected["params"])
    assert_same_bits(one["pgpe_params"], expected["pgpe_params"])
    # in JaxPlan the types of the first call differ from the others', and it compiles twice
    assert ours.pgpe.update.__wrapped__._cache_size() == 1
