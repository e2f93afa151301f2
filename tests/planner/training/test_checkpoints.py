"""A training that goes on from a checkpoint is the unbroken one, bit for bit."""

import math
import threading
from types import SimpleNamespace
from typing import Any

import jax
import numpy as np
import pytest
from helpers.problems import assert_same_bits, tiny_files
from helpers.trainings import FOREVER, KEY, paper_config

from mdpo_rddl.errors import InputError
from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.built import Built
from mdpo_rddl.planner.config.budgets import Budget
from mdpo_rddl.planner.training import first_iteration
from mdpo_rddl.planner.training.checkpoints import Checkpoints, TrainingState
from mdpo_rddl.planner.training.found import Found
from mdpo_rddl.planner.training.loop_state import WatchedLoop
from mdpo_rddl.planner.training.training import Training, TrainingResult, train
from mdpo_rddl.planner.upstream import JaxPlannerStatus, planner
from mdpo_rddl.problem.load import load_problem

CONFIGS = {
    "adaptive": paper_config(parallel_updates=2).with_values(
        "Optimize", stopping_rule="NoImprovementStoppingRule", stopping_rule_kwargs={"patience": 9}
    ),
    "calls": paper_config(method="JaxStraightLinePlan", method_kwargs={}).with_section(
        "MDPO", {"iterations_per_call": 4, "test_every": 2}
    ),
    "paired": paper_config(method="JaxStraightLinePlan", method_kwargs={})
    .with_section("Noise", {"method": "AnnealedNoise"})
    .without_section("MDPO"),
}
CONFIGS["pgpe"] = CONFIGS["paired"].with_values(
    "Planner", pgpe="GaussianPGPE", preprocessor="StaticNormalizer", parallel_updates=2
)
LONG = [pytest.param(name, marks=pytest.mark.long) for name in ("adaptive", "calls", "pgpe")]
# PGPE is annealed by the share of the time that is used: none of it
BUDGET = Budget(100, math.inf)


@pytest.fixture(scope="module", params=["paired", *LONG])
def built(request, tmp_path_factory) -> Built[Any]:
    problem = load_problem(*tiny_files(tmp_path_factory.mktemp("tiny"), spread=0.3))
    return build_planner(problem, CONFIGS[request.param])


@pytest.fixture(autouse=True)
def _sizes_do_not_depend_on_the_machine(monkeypatch):
    monkeypatch.setattr(first_iteration, "_CALL_SECONDS", FOREVER)


def trained(built: Built[Any], checkpoints: Checkpoints | None = None) -> TrainingResult:
    return train(built, KEY, BUDGET, checkpoints=checkpoints)


def assert_same(left: TrainingResult, right: TrainingResult) -> None:
    assert_same_bits(left.last_params_by_restart, right.last_params_by_restart)
    assert_same_bits(left.best_params, right.best_params)
    np.testing.assert_array_equal(left.sigma, right.sigma, strict=True)
    for name in ("history", "iterations", "best_iteration", "restart", "status"):
        assert getattr(left, name) == getattr(right, name)


@pytest.mark.long
def test_a_broken_run_is_the_unbroken_one(built):
    whole = trained(built)
    states: list[TrainingState] = []
    assert_same(trained(built, Checkpoints(0.0, states.append)), whole)
    # one a turn, but for the last
    assert [state.iterations for state in states] == sorted({s.iterations for s in states})
    assert states[-1].iterations < whole.iterations
    for state in (states[0], states[len(states) // 2], states[-1]):
        again: list[TrainingState] = []
        resumed = trained(built, Checkpoints(FOREVER, again.append, state))
        assert_same(resumed, whole)
        # the evaluation, which comes next, may be interrupted too
        assert all(later.iterations < whole.iterations for later in again)
        assert len(again) <= 1
        assert resumed.train_seconds > state.seconds
    # and again without any
    assert_same(trained(built), whole)


@pytest.mark.long
def test_a_run_may_be_broken_again_and_again(built):
    whole, state = trained(built), None
    for _ in range(4):
        states: list[TrainingState] = []
        trained(built, Checkpoints(0.0, states.append, state))
        state = states[len(states) // 3]
    assert_same(trained(built, Checkpoints(FOREVER, states.append, state)), whole)


def test_a_run_killed_after_its_time_was_used_up_does_its_last_call_again(built):
    states: list[TrainingState] = []
    trained(built, Checkpoints(0.0, states.append))
    state, following = states[1:3]
    # written while the last call's result was there already, and the evaluation began
    late = TrainingState(state.tensors, {**state.numbers, "seconds": 2.0})
    again: list[TrainingState] = []
    checkpoints = Checkpoints(0.0, again.append, late)
    resumed = train(built, KEY, Budget(100, 1.0), checkpoints=checkpoints)
    assert resumed.status == "time_budget_reached"
    assert resumed.iterations == following.iterations
    assert again == []  # it may be killed there any number of times
    if not built.planner.use_pgpe:  # annealed by the time
        best = {name.partition("/")[2]: value for name, value in following.tensors.items()}
        assert (resumed.best_return, resumed.best_iteration) == (
            best["best_return"],
            best["best_iteration"],
        )
        for i, leaf in enumerate(jax.tree.leaves(resumed.best_params)):
            np.testing.assert_array_equal(leaf, best[f"best_params/{i}"], strict=True)


@pytest.mark.parametrize(
    "changed",
    [
        {"iterations": 100},
        {"iterations": 10**30},
        {"iterations": 5.5},
        {"iterations": True},
        {"seconds": math.inf},
        {"seconds": math.nan},
        {"seconds": "1"},
        {"call": []},
        {"call": [0, 0]},
        {"call": [10**9, 1]},
        {"call": [1, 2]},
        {"call": None},
        {"rule": [1]},
        {"rule": {"callback": "x"}},
    ],
    ids=str,
)
def test_numbers_that_no_training_leaves_are_refused(changed):
    numbers = {"iterations": 99, "seconds": 0.0, "call": [50, 10], "rule": {"patience": 3}}
    TrainingState({}, numbers).require_numbers(100, (50, 10))
    with pytest.raises(ValueError, match=f"its {next(iter(changed))} "):
        TrainingState({}, {**numbers, **changed}).require_numbers(100, (50, 10))


def test_what_does_not_fit_is_refused(built):
    states: list[TrainingState] = []
    trained(built, Checkpoints(0.0, states.append))
    state = states[0]
    for name in ("found/best_params/0", "found/kept/sigma", "found/restart"):
        tensors = {key: value for key, value in state.tensors.items() if key != name}
        with pytest.raises(InputError, match="the checkpoint does not fit the planner"):
            trained(built, Checkpoints(1.0, states.append, TrainingState(tensors, state.numbers)))
    with pytest.raises(InputError, match="the checkpoint does not fit the planner"):
        trained(built, Checkpoints(1.0, states.append, TrainingState(state.tensors, {})))


def _damaged(state: TrainingState, name: str, value: np.ndarray) -> TrainingState:
    return TrainingState({**state.tensors, name: value}, state.numbers)


def test_tensors_of_other_shapes_and_types_are_refused_before_use(built):
    states: list[TrainingState] = []
    trained(built, Checkpoints(0.0, states.append))
    state = states[1]
    mistakes = {
        name: np.stack([value] * 3)
        for name, value in state.tensors.items()
        if name.endswith(("/0", "sigma", "_return", "key", "losses_sum")) and value.ndim
    }
    assert {"loop/params/0", "loop/opt_state/0", "found/kept/sigma"} <= set(mistakes)
    mistakes["loop/opt_state/0"] = state.tensors["loop/opt_state/0"].astype(np.complex64)
    for name, value in mistakes.items():
        broken, part = _damaged(state, name, value), name.partition("/")[2]
        with pytest.raises(InputError, match=f"does not fit the planner: its {part}"):
            trained(built, Checkpoints(1.0, states.append, broken))
    for name in ("found/restart", "found/best_restart"):
        broken = _damaged(state, name, np.asarray(99))
        with pytest.raises(InputError, match="names a restart"):
            trained(built, Checkpoints(1.0, states.append, broken))
    recorded = state.tensors["found/kept/iteration"]
    for name, value, said in (
        ("found/every", np.asarray(0), "it records every 0th iteration"),
        ("found/every", np.asarray(-7), "it records every -7th iteration"),
        ("found/best_iteration", np.asarray(-5), "its best_iteration is -5"),
        ("found/best_return", np.asarray(np.nan), "its best_return is nan"),
        ("found/kept/iteration", recorded - 99, "its recorded iterations are not in order"),
        ("found/kept/iteration", recorded + 0.5, "its recorded iterations are not in order"),
    ):
        with pytest.raises(InputError, match=f"does not fit the planner: {said}"):
            trained(built, Checkpoints(1.0, states.append, _damaged(state, name, value)))


def test_what_was_not_finite_is_counted_over_a_resumption():
    def callback(iteration: int, returns: list[float]) -> dict[str, Any]:
        return {
            "iteration": iteration,
            "status": JaxPlannerStatus.NO_PROGRESS,
            "train_return": np.zeros(2),
            "test_return": np.asarray(returns),
            "params": {"w": np.asarray([iteration, iteration + 0.5], np.float32)},
            "sigma": np.zeros((2, 3)),
        }

    whole = Found(in_calls=False)
    rows = [[1.0, 2.0], [np.nan, 3.0], [4.0, np.inf], [5.0, 6.0]]
    for i, returns in enumerate(rows):
        whole.add(callback(i, returns))
        if i == 1:
            structure = {"w": jax.ShapeDtypeStruct((), np.float32)}
            resumed = Found.resumed(False, whole.tensors(), structure, (2, 3))
        elif i > 1:
            resumed.add(callback(i, returns))
    assert resumed.not_finite == whole.not_finite == 2
    assert resumed.first_not_finite == whole.first_not_finite == 1
    assert float(resumed.suspect["w"]) == float(whole.suspect["w"]) == 0.0
    assert resumed.is_flat is whole.is_flat is True


def test_a_loop_that_begins_in_another_thread_has_its_own_averages():
    loop, plain = WatchedLoop(SimpleNamespace(use_pgpe=False), None), planner.RollingMean
    others: list[Any] = []
    thread = threading.Thread(target=lambda: others.append(planner.RollingMean(3)))
    with loop._averaging():
        own = planner.RollingMean(3)
        thread.start()
        thread.join()
    assert loop._averages == [own]
    assert [type(other) for other in others] == [plain]
    assert planner.RollingMean is plain


def test_an_interrupt_while_a_checkpoint_is_left_leaves_it_all_the_same(built):
    saved = []

    def save(state):
        if not saved:
            saved.append(None)
            raise KeyboardInterrupt
        saved.append(state)

    training = Training(built, KEY, BUDGET, lambda progress: None, Checkpoints(0.0, save))
    training.compile()
    training.advance()
    training.close()
    assert training.result().status == "interrupted"
    assert saved[-1].iterations == training.result().iterations
