"""Training: its budgets, what it keeps, and that without noise it is JaxPlan's own."""

import time
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
import pytest
from helpers.problems import assert_same_bits
from helpers.trainings import (
    FOREVER,
    HORIZON,
    KEY,
    Scripted,
    cart_planner,
    paper_config,
    reservoir,
    trained,
)

from mdpo_rddl.errors import Cancelled
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.planner import MDPOPlanner
from mdpo_rddl.planner.training import training
from mdpo_rddl.planner.training.training import (
    Progress,
    Training,
    TrainingResult,
    select_restart,
    train,
)
from mdpo_rddl.planner.upstream import JaxBackpropPlanner
from mdpo_rddl.planner.upstream import planner as jaxplan


@pytest.fixture(scope="module")
def compiling() -> tuple[MDPOPlanner, TrainingResult]:
    """A planner and its first training, which compiles it, with less time than that takes."""
    built = build_planner(reservoir(), paper_config())
    return built.planner, train(built, KEY, Budget(10**6, 0.3))


@pytest.fixture(scope="module")
def planner(compiling) -> MDPOPlanner:
    return compiling[0]


@pytest.fixture(scope="module")
def silent_planner() -> MDPOPlanner:
    config = paper_config().with_section("Noise", {"method": "NoNoise"})
    return build_planner(reservoir(), config).planner


def differ(left: Any, right: Any) -> bool:
    pairs = zip(jax.tree.leaves(left), jax.tree.leaves(right), strict=True)
    return any((np.asarray(one) != np.asarray(other)).any() for one, other in pairs)


# --- budgets -------------------------------------------------------------------------------


@pytest.mark.parametrize("iterations", [1, 2, 7])
def test_iterations_are_honoured(planner, iterations):
    result, progress = trained(planner, iterations)
    assert result.iterations == iterations
    assert result.status == "iter_budget_reached"
    assert [p.iteration for p in progress] == list(range(iterations))
    assert [p.fraction for p in progress] == [(i + 1) / iterations for i in range(iterations)]


def test_seconds_are_honoured_and_do_not_count_compilation(compiling):
    _, result = compiling
    assert result.status == "time_budget_reached"
    # had compilation counted, the first iteration would have been the last
    assert result.compile_seconds > 0.3
    assert result.iterations > 10
    assert result.train_seconds >= 0.3


def test_seconds_may_count_compilation(planner, monkeypatch):
    monkeypatch.setattr(training, "force_compilation", lambda *_: time.sleep(0.2))
    result, _ = trained(planner, 10**6, seconds=0.1, counts_compilation=True)
    assert result.status == "time_budget_reached"
    assert result.iterations == 1


def test_seconds_move_the_progress(planner):
    result, progress = trained(planner, 10**6, seconds=0.5)
    fractions = [p.fraction for p in progress]
    assert fractions == sorted(fractions)
    assert fractions[0] < 0.5
    assert fractions[-1] == 1.0
    assert result.status == "time_budget_reached"


def test_a_stopping_rule_ends_it(planner):
    rule = jaxplan.NoImprovementStoppingRule(patience=2)
    result, progress = trained(planner, 500, arguments={"stopping_rule": rule})
    best = [p.best_return for p in progress]
    assert result.status == "stopping_rule_reached"
    assert result.iterations < 500
    # two iterations without a better return: the last two, and no two before them
    stalls = [i for i in range(2, len(best)) if best[i] == best[i - 1] == best[i - 2]]
    assert stalls == [result.iterations - 1]


# --- parameters ----------------------------------------------------------------------------


def test_the_same_key_gives_the_same_parameters(planner):
    first, _ = trained(planner, 4)
    again, _ = trained(planner, 4)
    other, _ = trained(planner, 4, key=jax.random.PRNGKey(4))
    assert_same_bits(again.best_params, first.best_params)
    assert_same_bits(again.last_params_by_restart, first.last_params_by_restart)
    assert again.history == first.history
    assert differ(other.last_params, first.last_params)


def test_without_noise_the_parameters_are_those_of_jaxplan(silent_planner):
    arguments, _, _ = paper_config().jaxplan_arguments()
    callback = JaxBackpropPlanner(reservoir().model, **arguments).optimize(
        key=KEY, epochs=6, train_seconds=FOREVER, print_summary=False, print_progress=False
    )
    result, progress = trained(silent_planner, 6)
    assert_same_bits(result.last_params_by_restart, callback["params"])
    assert_same_bits(result.best_params, callback["best_params"])
    assert result.best_iteration == callback["last_iteration_improved"]
    assert len({record.train_return for record in result.history}) == 6
    assert result.history[-1].train_return == float(callback["train_return"][0])
    assert result.history[-1].test_return == float(callback["test_return"][0])
    assert progress[-1].best_return == float(callback["best_return"])
    assert result.status == callback["status"].name.lower()


def test_the_best_parameters_are_those_of_the_best_iteration(planner):
    result, progress = trained(planner, 100)
    returns = [p.test_return for p in progress]
    assert result.best_iteration == int(np.argmax(returns))
    assert [p.best_return for p in progress] == np.maximum.accumulate(returns).tolist()
    assert returns != sorted(returns)
    till_then, _ = trained(planner, result.best_iteration + 1)
    assert_same_bits(till_then.last_params, result.best_params)


def test_the_restart_with_the_best_iterate_is_chosen(tmp_path, monkeypatch):
    planner = cart_planner(tmp_path, noise="AdaptiveNoise", parallel_updates=3)
    callbacks: list[Any] = []
    generate = planner.optimize_generator

    def spied(**kwargs: Any) -> Iterator[Any]:
        for callback in generate(**kwargs):
            callbacks.append(callback)
            yield callback

    monkeypatch.setattr(planner, "optimize_generator", spied)
    result, _ = trained(planner, 4)
    last = callbacks[-1]
    returns = np.asarray(last["test_return"])
    assert len(set(returns.tolist())) == 3
    best = np.array([callback["test_return"] for callback in callbacks[-4:]])
    assert (result.best_iteration, result.restart) == np.unravel_index(best.argmax(), best.shape)
    assert_same_bits(result.last_params_by_restart, last["params"])
    assert_same_bits(result.last_params, jax.tree.map(lambda x: x[result.restart], last["params"]))
    assert_same_bits(result.best_params, last["best_params"])
    assert result.history[-1].test_return == float(returns[result.restart])
    assert max(record.test_return for record in result.history) == float(best.max())
    np.testing.assert_array_equal(result.sigma[-1], np.asarray(last["sigma"])[result.restart])
    expected = planner.params_structure(result.policy_hyperparams)
    found = jax.tree.map(lambda leaf: leaf.shape, result.last_params_by_restart)
    assert found == jax.tree.map(lambda leaf: (3, *leaf.shape), expected)
    restarts = [select_restart(result.last_params_by_restart, i) for i in range(3)]
    assert differ(restarts[0], restarts[1])
    assert differ(restarts[1], restarts[2])


# --- records -------------------------------------------------------------------------------


def test_the_records_agree_with_the_progress_and_the_noise(planner):
    result, progress = trained(planner, 7)
    assert [record.iteration for record in result.history] == list(range(7))
    assert [record.test_return for record in result.history] == [p.test_return for p in progress]
    assert result.sigma.shape == (7, HORIZON)
    means = [record.mean_sigma for record in result.history]
    np.testing.assert_allclose(means, result.sigma.mean(axis=1), rtol=1e-6)
    # the preset's noise: from 0 to its largest at the most sensitive step
    largest = planner.noise.sigma_max
    assert result.sigma.min() >= 0.0
    np.testing.assert_allclose(result.sigma[0].max(), largest, rtol=1e-6)
    assert result.sigma[0].min() < 0.9 * largest


def test_without_noise_the_recorded_scale_is_zero(silent_planner):
    result, _ = trained(silent_planner, 3)
    assert result.sigma.tolist() == [[0.0] * HORIZON] * 3
    assert [record.mean_sigma for record in result.history] == [0.0] * 3


@pytest.mark.parametrize("iterations", [600, 601, 602, 5000])
def test_a_long_run_is_recorded_evenly_from_its_first_to_its_last_iteration(iterations):
    result, _ = trained(Scripted([[float(i)] for i in range(iterations)]), iterations)
    recorded = [record.iteration for record in result.history]
    steps = set(np.diff(recorded[:-1]).tolist())
    assert (recorded[0], recorded[-1]) == (0, iterations - 1)
    assert len(steps) == 1
    assert 0 < recorded[-1] - recorded[-2] <= steps.pop()
    assert 300 <= len(recorded) <= 601
    assert [record.test_return for record in result.history] == recorded
    assert result.sigma[:, 0].tolist() == recorded


def test_a_run_that_the_seconds_end_is_recorded_like_any_other():
    returns = [[float(i)] for i in range(2000)]
    result, _ = trained(Scripted(returns, last_status="TIME_BUDGET_REACHED"), 10**6)
    assert result.status == "time_budget_reached"
    assert len(result.history) > 300
    assert result.history[-1].iteration == 1999


# --- interrupts ----------------------------------------------------------------------------


class Interrupt:
    """Presses Ctrl-C, or cancels, when an iteration is reported."""

    def __init__(self, iteration: int, kind: type[BaseException] = KeyboardInterrupt) -> None:
        self.iteration, self.kind = iteration, kind

    def __call__(self, progress: Progress) -> None:
        if progress.iteration == self.iteration:
            raise self.kind


@pytest.mark.parametrize(
    ("iteration", "kind"), [(0, KeyboardInterrupt), (4, KeyboardInterrupt), (4, Cancelled)]
)
def test_an_interrupt_keeps_what_was_found(planner, iteration, kind):
    result, _ = trained(planner, 900, on_progress=Interrupt(iteration, kind))
    whole, _ = trained(planner, iteration + 1)
    assert result.status == "interrupted"
    assert result.iterations == iteration + 1
    assert result.history == whole.history
    assert_same_bits(result.last_params, whole.last_params)
    assert_same_bits(result.best_params, whole.best_params)
    assert result.best_iteration == whole.best_iteration


def test_the_last_iteration_before_an_interrupt_is_recorded():
    planner = Scripted([[float(i)] for i in range(2000)])
    result, _ = trained(planner, 2000, on_progress=Interrupt(1801))
    assert [record.iteration for record in result.history[-2:]] == [1800, 1801]
    assert result.sigma[-1, 0] == 1801.0


@pytest.mark.parametrize("run", [0, 1])
def test_an_interrupt_before_the_first_iteration_is_passed_on(run):
    # the first generator only compiles, the second trains
    planner = Scripted([[1.0]], interrupted_run=run)
    with pytest.raises(KeyboardInterrupt):
        trained(planner, 5)
    assert planner.runs == run + 1


def test_a_training_in_parts_is_the_training_in_one_go():
    returns = [[1.0, 4.0], [5.0, 2.0], [0.0, 3.0]]
    whole, _ = trained(Scripted(returns), 3)
    built = Built(Scripted(returns), Budget(3, FOREVER), {})
    parts = Training(built, KEY)
    parts.compile()
    seen = []
    while not parts.has_ended:
        parts.advance(seconds=0.0)  # one call at least
        seen.append(parts.result().iterations)
    assert seen == [1, 2, 3, 3]
    result = parts.result()
    assert (
        (result.best_iteration, result.restart) == (whole.best_iteration, whole.restart) == (1, 0)
    )
    assert result.history == whole.history
    assert result.status == whole.status
    parts.advance(seconds=0.0)
    assert parts.result().iterations == 3


def test_what_a_training_has_so_far_is_its_result():
    training = Training(Built(Scripted([[1.0], [9.0]]), Budget(2, FOREVER), {}), KEY)
    training.compile()
    training.advance(seconds=0.0)
    assert float(training.result().best_params["w"]) == 0.0
    training.advance(seconds=0.0)
    assert float(training.result().best_params["w"]) == 100.0
