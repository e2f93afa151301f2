"""Many iterations in one compiled call: the same training, tests on their own cadence."""

import dataclasses
import json
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.problems import assert_same_bits, make_plan, make_planner, tiny_files

from mdpo_rddl import AdaptiveNoise, NoNoise
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.training.training import select_restart
from mdpo_rddl.planner.update.calls import Calls
from mdpo_rddl.planner.update.sizes import CallSizes
from mdpo_rddl.problem.load import load_problem

KEY = jax.random.PRNGKey(5)
SILENT = {"print_summary": False, "print_progress": False, "train_seconds": 1e300}


ABSOLUTE = AdaptiveNoise(sigma_max=10.0, unit="absolute")


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    return load_problem(*tiny_files(tmp_path_factory.mktemp("tiny"), horizon=4, spread=0.3))


def tiny_planner(problem, **arguments):
    return make_planner(MDPOPlanner, problem, make_plan("drp"), **{"noise": ABSOLUTE, **arguments})


@pytest.fixture(scope="module")
def plain(problem):
    """One iteration in each call, as JaxPlan has it."""
    return tiny_planner(problem)


@pytest.fixture(scope="module")
def two_calls_of_four(problem):
    return tiny_planner(problem, iterations_per_call=4, test_every=2)


def callbacks(planner, epochs, **arguments):
    return list(planner.optimize_generator(key=KEY, epochs=epochs, **SILENT, **arguments))


def assert_close(ours, theirs):
    assert jax.tree.structure(ours) == jax.tree.structure(theirs)
    for one, other in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize(
    "noise",
    [
        NoNoise(),
        pytest.param(AdaptiveNoise(sigma_max=0.5, unit="absolute"), marks=pytest.mark.long),
    ],
)
def test_the_training_is_that_of_jaxplan_s_loop(problem, noise):
    common = {"noise": noise, "parallel_updates": 2}
    single = callbacks(tiny_planner(problem, **common), 12)
    calls = callbacks(tiny_planner(problem, **common, iterations_per_call=4, test_every=1), 12)
    assert [c["iteration"] for c in calls] == [3, 7, 11]
    for call in calls:
        same = single[call["iteration"]]
        assert set(call) == set(same)
        for log in ("train_log", "test_log"):
            assert set(call[log]) == set(same[log])
        for name in ("params", "best_params", "train_return", "test_return", "best_return"):
            assert_close(call[name], same[name])
        for name in ("sigma", "grad", "best_grad"):
            assert_close(call[name], same[name])
        assert call["best_index"] == same["best_index"]
        assert call["last_iteration_improved"] == same["last_iteration_improved"]
        np.testing.assert_array_equal(call["key"], same["key"])
        assert call["status"].is_terminal() == (call["iteration"] == 11)


@pytest.mark.long
def test_results_do_not_depend_on_the_size_of_a_call(two_calls_of_four):
    last = {}
    for size in (2, 4, 8):
        with two_calls_of_four.call_sizes(size, 2):
            last[size] = callbacks(two_calls_of_four, 8)[-1]
    for name in ("params", "best_params", "best_return", "test_return", "sigma", "key"):
        assert_same_bits(last[2][name], last[4][name])
        assert_same_bits(last[2][name], last[8][name])


@pytest.mark.long
def test_a_test_every_few_iterations(plain, two_calls_of_four):
    single = callbacks(plain, 8, test_rolling_window=1)
    calls = callbacks(two_calls_of_four, 8, test_rolling_window=2)
    tests = np.array([single[i]["test_return"][0] for i in (1, 3, 5, 7)])
    np.testing.assert_allclose(calls[0]["test_return"], np.mean(tests[:2]), rtol=1e-4)
    np.testing.assert_allclose(calls[1]["test_return"], np.mean(tests[2:]), rtol=1e-4)
    smooth = [tests[0], *((tests[1:] + tests[:-1]) / 2)]
    best = int(np.argmax(smooth))
    np.testing.assert_allclose(calls[1]["best_return"], smooth[best], rtol=1e-4)
    assert calls[1]["last_iteration_improved"] == 2 * best + 1
    assert_close(
        calls[1]["best_params"], jax.tree.map(lambda p: p[0], single[2 * best + 1]["params"])
    )


@pytest.mark.parametrize("epochs", [1, 3, 4, 6, 9])
def test_any_number_of_iterations(plain, two_calls_of_four, epochs):
    found = callbacks(two_calls_of_four, epochs)
    assert [c["iteration"] for c in found] == [*range(3, epochs - 1, 4), epochs - 1]
    assert found[-1]["status"].name == "ITER_BUDGET_REACHED"
    single = callbacks(plain, epochs)[-1]
    assert_close(found[-1]["params"], single["params"])
    assert np.isfinite(found[-1]["test_return"]).all()


def test_nothing_is_compiled_anew_for_other_numbers(problem):
    planner = tiny_planner(problem, iterations_per_call=4, test_every=2)
    callbacks(planner, 8)
    compiled = []

    def monitor(event, duration, **_):
        compiled.append(event)

    jax.monitoring.register_event_duration_secs_listener(monitor)
    try:
        planner.noise = AdaptiveNoise(alpha=3.0, sigma_max=0.1, unit="absolute")
        with planner.call_sizes(6, 3):
            list(planner.optimize_generator(key=jax.random.PRNGKey(8), epochs=11, **SILENT))
    finally:
        jax.monitoring.unregister_event_duration_listener(monitor)
    assert [event for event in compiled if "backend_compile" in event] == []


def test_a_restart_that_is_not_a_number_is_not_the_best(problem):
    planner = tiny_planner(problem, iterations_per_call=2, parallel_updates=2, noise=NoNoise())
    started = planner.initialize

    def poison(*arguments):
        params, opt_state, opt_aux = started(*arguments)
        return jax.tree.map(lambda p: p.at[0].set(np.nan), params), opt_state, opt_aux

    planner.initialize = poison
    last = callbacks(planner, 4)[-1]
    assert np.isnan(last["test_return"][0])
    assert last["best_index"] == 1
    assert np.isfinite(last["best_return"])
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(last["best_params"]))


def test_a_warm_start_continues_jaxplan_s_keys(plain, two_calls_of_four):
    guess = callbacks(plain, 2)[-1]["best_params"]
    single = callbacks(plain, 4, guess=guess)[-1]
    calls = callbacks(two_calls_of_four, 4, guess=guess)[-1]
    np.testing.assert_array_equal(calls["key"], single["key"])
    assert_close(calls["params"], single["params"])


@pytest.mark.long
def test_straight_line_plans_too(problem):
    common = {"noise": AdaptiveNoise(sigma_max=0.5, unit="absolute")}
    single = make_planner(MDPOPlanner, problem, make_plan("slp"), **common)
    calls = make_planner(MDPOPlanner, problem, make_plan("slp"), **common, iterations_per_call=3)
    assert_close(callbacks(calls, 6)[-1]["params"], callbacks(single, 6)[-1]["params"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"iterations_per_call": 4, "test_every": 3}, "must divide"),
        ({"iterations_per_call": 0}, "at least 1"),
        ({"iterations_per_call": 2, "test_every": 0}, "at least 1"),
        ({"iterations_per_call": 2, "pgpe": "default"}, "pgpe=None"),
    ],
)
def test_numbers_that_make_no_sense(problem, arguments, message):
    if arguments.get("pgpe"):
        from mdpo_rddl.planner.upstream import GaussianPGPE

        arguments = {**arguments, "pgpe": GaussianPGPE()}
    with pytest.raises(ValueError, match=message):
        tiny_planner(problem, **arguments)


SHARDED = """
import json, sys
import jax
jax.config.update("jax_num_cpu_devices", int(sys.argv[3]))
import numpy as np
from mdpo_rddl import AdaptiveNoise, JaxDeepReactivePolicy, MDPOPlanner, load_problem
problem = load_problem(sys.argv[1], sys.argv[2])
planner = MDPOPlanner(problem.model, JaxDeepReactivePolicy(topology=[12]), batch_size_train=1,
    batch_size_test=2, pgpe=None, parallel_updates=6,
    noise=AdaptiveNoise(sigma_max=0.5, unit="absolute"),
    compiler_kwargs={"print_warnings": False}, iterations_per_call=4, test_every=2)
last = planner.optimize(key=jax.random.PRNGKey(1), epochs=8, print_summary=False,
    print_progress=False)
leaf = jax.tree.leaves(last["params"])[0]
print(json.dumps({"devices": len(leaf.sharding.device_set), "best": float(last["best_return"]),
    "returns": np.asarray(last["test_return"]).tolist()}))
"""


@pytest.mark.long
def test_restarts_are_spread_over_devices(tmp_path):
    files = tiny_files(tmp_path, spread=0.3)
    found = {}
    for devices in (1, 4):
        command = [sys.executable, "-W", "ignore", "-c", SHARDED, *files, str(devices)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        found[devices] = json.loads(done.stdout.strip().splitlines()[-1])
    # six restarts on four devices: three take two each
    assert [found[n]["devices"] for n in (1, 4)] == [1, 3]
    np.testing.assert_allclose(found[4]["returns"], found[1]["returns"], rtol=1e-3)
    np.testing.assert_allclose(found[4]["best"], found[1]["best"], rtol=1e-3)


RULES = [
    dataclasses.replace(ABSOLUTE, **values)
    for values in ({"sigma_max": 0.1}, {"alpha": 3.0}, {"quantile": 0.5})
]
RATES = [0.001, 0.01, 0.1]


@pytest.mark.long
def test_a_sweep_is_one_run(problem):
    arguments = {"iterations_per_call": 4, "parallel_updates": 3}
    planner = tiny_planner(problem, **arguments)
    same = callbacks(planner, 4)[-1]
    planner.vary_restarts(noise=RULES, learning_rate=RATES)
    varied = callbacks(planner, 4)[-1]
    for place in (2,):
        alone = tiny_planner(
            problem,
            **arguments,
            noise=RULES[place],
            optimizer_kwargs={"learning_rate": RATES[place]},
        )
        expected = callbacks(alone, 4)[-1]
        for name in ("params", "sigma"):
            assert_close(*(select_restart(found[name], place) for found in (varied, expected)))
    planner.vary_restarts()
    assert_same_bits(callbacks(planner, 4)[-1]["params"], same["params"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"noise": RULES[:2]}, "noise: 3 needed, got 2"),
        ({"learning_rate": RATES[:1]}, "learning_rate: 3 needed, got 1"),
        ({"noise": [NoNoise()] * 3}, "cannot change"),
    ],
)
def test_a_sweep_needs_one_value_for_each_restart(problem, arguments, message):
    planner = tiny_planner(problem, parallel_updates=3)
    with pytest.raises(ValueError, match=message):
        planner.vary_restarts(**arguments)


def test_a_sweep_is_counted_without_companions(problem):
    planner = tiny_planner(problem, noise=None)
    assert planner.parallel_updates == 2 * planner.restarts == 2
    for given in (3, 2):
        with pytest.raises(ValueError, match=f"learning_rate: 1 needed, got {given}"):
            planner.vary_restarts(learning_rate=RATES[:given])
    planner.vary_restarts(learning_rate=RATES[:1])


def falling(*arguments):
    """An update in place of JaxPlan's: each lane's loss falls at a pace of its own, and swings."""
    _, params, *_, model, _, state, aux = arguments
    step = 1.0 + jnp.arange(len(params["p"]), dtype=jnp.float32)
    params = {"p": params["p"] + step}
    flags = jnp.ones(len(step), bool)
    return params, flags, state, aux, -params["p"], {"grad": params}, model, ~flags


def swinging(key, params, *_):
    return jnp.sin(params["p"]) - 0.1 * params["p"], ({}, None)


def entries_of_three_calls(lanes, watched):
    """Of all lanes, and of the first ones."""
    calls = Calls()
    calls.compile(falling, swinging, None)
    calls.test_fluents = None, None
    calls.begin({"key": KEY, "epochs": 23, "test_rolling_window": 2})
    params = {"p": np.zeros(lanes, np.float32)}
    aux = {"call": calls.first_state(params, None, True, watched)}
    found = []
    for _ in range(3):
        rest = params, None, None, None, None, None, None, aux
        params, _, _, aux, *_ = calls.update(lambda: CallSizes(8, 1), KEY, *rest)
        found.append((calls.callback_entries(), watched and calls.watched_entries()))
    return found


@pytest.mark.parametrize("watched", [1, 2, 3])
def test_the_best_of_the_first_lanes_is_that_of_calls_with_these_alone(watched):
    both, alone = entries_of_three_calls(4, watched), entries_of_three_calls(watched, None)
    for (of_all, of_first), (theirs, _) in zip(both, alone, strict=True):
        assert_same_bits(of_first, theirs)
        assert of_all["best_return"] > theirs["best_return"]
