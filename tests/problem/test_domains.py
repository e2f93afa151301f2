"""Proves that our six RDDL problems are the IPC 2023 problems they stand for.

Each problem in ``domains/`` and ``instances/`` is loaded next to its original from the package
rddlrepository, whose horizon is set to the 120 steps used here. Three things are compared:

- the declarations: names, types, objects, defaults, constants, initial state, action boxes,
  horizon and discount;
- the numpy simulator: the same seed and the same random legal actions give the same states and
  rewards for a whole episode, so the random draws come in the same order too;
- the model that JaxPlan plans on: the same key gives the same next state, reward and gradients,
  so the relaxations see the same comparisons and branches.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from pyRDDLGym.core.env import RDDLEnv
from pyRDDLGym_jax.core.logic import DefaultJaxRDDLCompilerWithGrad
from rddlrepository.core.manager import RDDLRepoManager

ROOT = Path(__file__).resolve().parents[2]
HORIZON = 120

# Our instance: our domain, the name in rddlrepository, the number of the instance there.
PROBLEMS = {
    "hvac10": ("hvac", "HVAC_ippc2023", "4"),
    "hvac20": ("hvac", "HVAC_ippc2023", "5"),
    "powergen7": ("powergen", "PowerGen_ippc2023", "4"),
    "powergen11": ("powergen", "PowerGen_ippc2023", "5"),
    "reservoir15": ("reservoir", "Reservoir_ippc2023", "4"),
    "reservoir30": ("reservoir", "Reservoir_ippc2023", "5"),
}

# Ranges to draw from where the problem has no bound. Heat is kept small: its cost is quadratic,
# and a larger one would hide the other reward terms below the tolerance.
OPEN_BOXES = {"fan-in": (0.05, 20.05), "heat-input": (-100.0, 100.0)}

# The two instances of a domain share its equations, so one of them is enough for the gradients.
RELAXED = ("hvac10", "powergen7", "reservoir15")

# Ranges of the states at which the relaxed models are compared: wide enough to be on both sides
# of every threshold, and off the levels that the dynamics would keep to.
STATE_RANGES = {
    "temp-zone": (10.0, 35.0),
    "temp-heater": (0.0, 30.0),
    "temperature": (-35.0, 45.0),
    "prevProd": (0.0, 20.0),
    "rlevel": (0.0, 500.0),
    "occupied": (0.0, 1.0),
    "prevOn": (0.0, 1.0),
}

# As JaxPlan plans (weight 100, forward values exact), and with soft forward values and a weight
# low enough that every comparison and connective shows in the numbers.
RELAXATIONS = {
    "planner": {
        "sigmoid_weight": 100.0,
        "argmax_weight": 100.0,
        "floor_weight": 100.0,
        "round_weight": 100.0,
        "switch_weight": 100.0,
        "bernoulli_sigmoid_weight": 100.0,
    },
    "soft": {"sigmoid_weight": 0.1, "use_sigmoid_ste": False, "use_if_else_ste": False},
}

Values = dict[str, Any]


def make_env(domain: str, instance: str) -> RDDLEnv:
    """Build an environment the way the planners are evaluated: vectorized and checked."""
    return RDDLEnv(domain, instance, vectorized=True, enforce_action_constraints=True)


def make_pair(name: str) -> tuple[RDDLEnv, RDDLEnv]:
    """Return our problem and its original, whose horizon alone is changed."""
    domain, repo_name, number = PROBLEMS[name]
    ours = make_env(
        str(ROOT / "domains" / f"{domain}.rddl"), str(ROOT / "instances" / f"{name}.rddl")
    )
    info = RDDLRepoManager().get_problem(repo_name)
    original = make_env(info.get_domain(), info.get_instance(number))
    original.horizon = HORIZON
    return ours, original


@pytest.fixture(scope="module")
def pairs() -> Callable[[str], tuple[RDDLEnv, RDDLEnv]]:
    """Parse each problem once: parsing is most of the cost of an environment."""
    cache: dict[str, tuple[RDDLEnv, RDDLEnv]] = {}

    def get(name: str) -> tuple[RDDLEnv, RDDLEnv]:
        if name not in cache:
            cache[name] = make_pair(name)
        return cache[name]

    return get


def assert_close(ours: Any, original: Any, what: str, rtol: float = 1e-9) -> None:
    """Require finite and equal numbers; floating-point reordering is all that may differ."""
    assert np.all(np.isfinite(original)), what
    np.testing.assert_allclose(
        np.asarray(ours, dtype=float),
        np.asarray(original, dtype=float),
        rtol=rtol,
        atol=1e-9,
        err_msg=what,
    )


def assert_same_values(ours: Values, original: Values) -> None:
    """Require the same names with exactly the same values, of the same type."""
    assert set(ours) == set(original)
    for name, value in original.items():
        np.testing.assert_array_equal(ours[name], value, err_msg=name)
        assert np.asarray(ours[name]).dtype == np.asarray(value).dtype, name


def random_actions(env: RDDLEnv, rng: np.random.Generator) -> Values:
    """Draw legal actions.

    One random scale per step on top of the uniform draws makes idle and full-on steps common, so
    that both sides of every threshold are visited.
    """
    scale = rng.random()
    actions = {}
    for name in env.model.action_fluents:
        low, high = env._bounds[name]
        open_low, open_high = OPEN_BOXES.get(name, (0.0, 0.0))
        low = np.where(np.isfinite(low), low, open_low)
        high = np.where(np.isfinite(high), high, open_high)
        actions[name] = low + (high - low) * scale * rng.random(low.shape)
    return actions


@pytest.mark.parametrize("name", PROBLEMS)
def test_declarations_equal(name: str, pairs: Callable[[str], tuple[RDDLEnv, RDDLEnv]]) -> None:
    """Names, objects, constants, initial state, boxes and episode settings are the IPC ones."""
    ours, original = pairs(name)
    for attribute in (
        "domain_name",
        "type_to_objects",
        "variable_types",
        "variable_params",
        "variable_ranges",
        "variable_defaults",
        "max_allowed_actions",
        "discount",
    ):
        assert getattr(ours.model, attribute) == getattr(original.model, attribute), attribute
    assert ours.horizon == ours.model.horizon == HORIZON

    # Constants, initial state and default actions.
    assert_same_values(ours.sampler.init_values, original.sampler.init_values)

    assert set(ours._bounds) == set(original._bounds)
    for fluent, (low, high) in original._bounds.items():
        np.testing.assert_array_equal(ours._bounds[fluent][0], low, err_msg=fluent)
        np.testing.assert_array_equal(ours._bounds[fluent][1], high, err_msg=fluent)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("name", PROBLEMS)
def test_episode_equal(
    name: str, seed: int, pairs: Callable[[str], tuple[RDDLEnv, RDDLEnv]]
) -> None:
    """A whole episode of random actions gives the same states, rewards and end."""
    ours, original = pairs(name)
    rng = np.random.default_rng(100 + seed)
    state, _ = ours.reset(seed=seed)
    expected, _ = original.reset(seed=seed)
    assert_same_values(state, expected)

    for step in range(HORIZON):
        actions = random_actions(original, rng)
        state, reward, terminated, truncated, _ = ours.step(actions)
        expected, expected_reward, *expected_end, _ = original.step(actions)
        assert set(state) == set(expected)
        for fluent, value in expected.items():
            assert_close(state[fluent], value, f"{fluent} at step {step}")
        assert_close(reward, expected_reward, f"reward at step {step}")
        assert [terminated, truncated] == expected_end == [False, step == HORIZON - 1]


def is_legal(env: RDDLEnv, values: Values) -> bool:
    """Tell whether the initial state, changed by ``values``, breaks no rule of the problem."""
    sampler = env.sampler
    sampler.subs = {**sampler.init_values, **values}
    return sampler.check_action_preconditions({}, silent=True) and sampler.check_state_invariants(
        silent=True
    )


@pytest.mark.parametrize("name", PROBLEMS)
def test_rules_equal(name: str, pairs: Callable[[str], tuple[RDDLEnv, RDDLEnv]]) -> None:
    """Both problems accept each bound, refuse what lies outside, and refuse the same networks.

    The bounds alone do not prove it: pyRDDLGym leaves a rule that is no box out of them.
    """
    ours, original = pairs(name)
    for fluent, bounds in original._bounds.items():
        for bound, outwards in zip(bounds, (-1e-6, 1e-6), strict=True):
            if np.all(np.isfinite(bound)):
                for offset, accepted in ((0.0, True), (outwards, False)):
                    value = np.array(bound, dtype=float)
                    value.flat[-1] += offset
                    for env in (ours, original):
                        assert is_legal(env, {fluent: value}) == accepted, (fluent, offset)

    for fluent, value in original.sampler.init_values.items():
        if original.model.variable_ranges[fluent] == "bool":
            flipped = {fluent: np.logical_not(value)}
            assert is_legal(ours, flipped) == is_legal(original, flipped), fluent


@pytest.fixture
def keep_x64() -> Iterator[None]:
    """Put back the precision of JAX, which the compiler sets for the whole process."""
    before = jax.config.jax_enable_x64
    yield
    jax.config.update("jax_enable_x64", before)


def compile_relaxed(env: RDDLEnv, options: Values) -> Callable[..., Any]:
    """Compile one relaxed step into f(key, actions, states) -> (outputs, gradients).

    The gradients are those of a fixed random combination of the reward and the next states, so
    that each of them counts. Double precision keeps the tolerance tight.
    """
    compiler = DefaultJaxRDDLCompilerWithGrad(
        env.model, use64bit=True, print_warnings=False, **options
    )
    compiler.compile()
    step = compiler.compile_transition()
    fluents, constants = compiler.split_fluent_nonfluent(compiler.init_values)
    params = compiler.model_aux["params"]

    def outputs(key: Any, actions: Values, states: Values) -> tuple[Any, Values]:
        after, log, _ = step(key, actions, {**fluents, **states}, constants, params)
        result = {name: after[name] for name in sorted(states)}
        result["reward"] = log["reward"]
        weights = np.random.default_rng(0)
        total = sum((weights.normal(size=v.shape) * v).sum() for v in result.values())
        return total, {**result, "error": log["error"]}

    return jax.jit(jax.value_and_grad(outputs, argnums=(1, 2), has_aux=True))


@pytest.mark.parametrize("relaxation", RELAXATIONS)
@pytest.mark.parametrize("name", RELAXED)
def test_relaxed_model_equal(
    name: str,
    relaxation: str,
    pairs: Callable[[str], tuple[RDDLEnv, RDDLEnv]],
    keep_x64: None,
) -> None:
    """JaxPlan's relaxation of both models agrees in values and in gradients."""
    ours, original = pairs(name)
    ours_step = compile_relaxed(ours, RELAXATIONS[relaxation])
    original_step = compile_relaxed(original, RELAXATIONS[relaxation])
    rng = np.random.default_rng(7)
    for sample in range(5):
        key = jax.random.PRNGKey(sample)
        # The noise that planners add to their actions may leave the boxes.
        actions = {
            fluent: value + rng.normal(scale=10.0, size=value.shape)
            for fluent, value in random_actions(original, rng).items()
        }
        states = {
            fluent: rng.uniform(*STATE_RANGES[fluent], size=np.shape(value))
            for fluent, value in original.sampler.init_values.items()
            if fluent in original.model.state_fluents
        }
        (_, values), gradients = ours_step(key, actions, states)
        (_, expected), expected_gradients = original_step(key, actions, states)
        assert set(values) == set(expected)
        for fluent, value in expected.items():
            assert_close(values[fluent], value, f"{fluent} of sample {sample}")
        for gradient, expected_gradient in zip(gradients, expected_gradients, strict=True):
            for fluent, value in expected_gradient.items():
                what = f"gradient of {fluent} of sample {sample}"
                assert_close(gradient[fluent], value, what, rtol=1e-8)
