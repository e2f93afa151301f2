"""Arms go on in another process with what they had there: optimisers, populations, archives."""

import json
import time
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.lake_arenas import FOREVER, begun, in_arena, lake_arena, shared
from helpers.problems import assert_same_bits

from mdpo_rddl.auto.arena.arena import Arena
from mdpo_rddl.auto.arms import gradient
from mdpo_rddl.auto.arms.exploration import ExplorationArm
from mdpo_rddl.auto.arms.gradient import GradientArm
from mdpo_rddl.auto.arms.own_weights import Around, OwnWeightsArm
from mdpo_rddl.auto.arms.plan_search import Evolving, PlanArm
from mdpo_rddl.auto.arms.simple import RANDOM_RULE, Rules, SimpleArm
from mdpo_rddl.auto.common.candidate import NOOP
from mdpo_rddl.auto.common.state import UNFIT, State
from mdpo_rddl.auto.search import plan_population
from mdpo_rddl.auto.search.weights import simple_weights, weights_of
from mdpo_rddl.planner.training.checkpoints import TrainingState


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    return lake_arena(tmp_path_factory.mktemp("lake"))


@pytest.fixture
def arena(compiled):
    return in_arena(compiled)


class StoppedError(Exception):
    """In place of the end of a process."""


def left_by(make: Callable[[Arena], object], compiled: Arena, pulses: int) -> State:
    """The state of an arm that is stopped in a slice, as it comes out of a file."""
    left, count = [], iter(range(pulses))

    def pulse() -> None:
        if next(count, None) is None:
            left.append(arm.state())
            raise StoppedError

    arm = make(in_arena(compiled, pulse))
    with pytest.raises(StoppedError):
        arm.work(time.monotonic() + FOREVER)
    return through_json(left[0])


def through_json(state: State) -> State:
    tensors = {name: np.array(tensor) for name, tensor in state.tensors.items()}
    return State(tensors, json.loads(json.dumps(dict(state.values))))


def worked(arm, seconds: float = 0.0):
    """Its candidates after a slice that is over at once."""
    arm.work(time.monotonic() + seconds)
    return arm.take_candidates()


def test_shared_weights_go_on_in_the_middle_of_a_slice(compiled, arena):
    state = left_by(shared, compiled, 5)
    assert state.tensors["simple"].shape[0] == 1
    assert state.values["adaptation"]["iterations"] == 5
    arm = shared(arena)
    arm.restore(state)
    # it has the state until it goes on, and hands in what was found though the slice is over
    assert arm.state().part("adaptation").values == state.part("adaptation").values
    (candidate,) = worked(arm)
    mean = state.part("adaptation").tensors["mean"]
    assert arm.log.iterations == 0
    assert np.any(mean != 0.0)
    assert candidate.label == "shared weights"
    # the best of what the slice has found
    rule = simple_weights(arena.noop, arena.plan).to_params(mean)
    assert_same_bits(candidate.params["shared"], rule["shared"])
    assert set(arm.state().tensors) == {"simple"}
    assert arm.state().values == {"ended": 1, "others": 0, "at_rule": True}


def test_own_weights_go_on_around_the_policy_that_they_began_with(compiled, arena):
    def own(somewhere: Arena) -> OwnWeightsArm:
        return OwnWeightsArm("own weights", somewhere, Around())

    state = left_by(own, compiled, 5)
    arm = own(arena)
    arm.restore(state)
    (candidate,) = worked(arm)
    mean = state.part("adaptation").tensors["mean"]
    assert np.any(mean != 0.0)
    assert candidate.params["own"]["pump"]["bias"] == pytest.approx(own_bias(arena, mean), rel=1e-5)
    # around another policy the adaptation is none
    other = own(in_arena(compiled))
    other._arena.judge.record(other._arena.candidate("", "constant", arena.constant))
    other.restore(state)
    (candidate,) = worked(other)
    assert_same_bits(candidate.params["own"], other._arena.incumbent.params["own"])


def own_bias(arena: Arena, mean: np.ndarray) -> np.ndarray:
    weights = weights_of(arena.noop, ["shared", "own"])
    return np.asarray(weights.to_params(mean)["own"]["pump"]["bias"])


@pytest.mark.parametrize("name", ["plan", "exploration"])
def test_plans_go_on_with_the_best_of_them(compiled, arena, name, monkeypatch):
    # or the exploration ends at once
    monkeypatch.setattr(plan_population, "return_to_beat_by_luck", lambda noop, rollouts: np.inf)

    def planning(somewhere: Arena) -> PlanArm | ExplorationArm:
        if name == "exploration":
            return ExplorationArm(somewhere)
        return PlanArm("plan", somewhere, Evolving())

    state = left_by(planning, compiled, 5)
    elites = state.tensors["elites"]
    arm = planning(arena)
    arm.restore(state)
    arm.work(time.monotonic())
    (candidate,) = arm.take_candidates()
    np.testing.assert_array_equal(arena.plans.plan_of(candidate.params), elites[0])
    if name == "exploration":
        assert len(arm._archive) == len(state.tensors["archive/cells"]) > 1
    with pytest.raises(UNFIT):
        planning(arena).restore(State({**state.tensors, "elites": elites[:, :, :0]}, state.values))


def test_a_rule_is_offered_once_more(arena):
    first = SimpleArm(arena)
    first.rules = Rules.FEW
    (rule,) = worked(first)
    second = SimpleArm(arena)
    second.restore(through_json(first.state()))
    labels = {candidate.label: candidate for candidate in worked(second)}
    assert_same_bits(labels[RANDOM_RULE].params, rule.params)
    assert {NOOP, RANDOM_RULE} < set(labels)


def make_gradient(arena: Arena) -> GradientArm:
    return GradientArm(arena)


@pytest.mark.long
@pytest.mark.parametrize("make", [make_gradient])
def test_a_training_goes_on_with_its_optimiser(compiled, arena, make):
    first = begun(make(arena))
    first.work(time.monotonic())
    state = through_json(first.state())
    done = first.log.iterations
    assert done > 0
    first.close()
    second = make(in_arena(compiled))
    second.restore(state)
    assert second.state() is state  # until it has gone on
    begun(second)
    second.work(time.monotonic())
    assert second.log.iterations > done
    later = second.state()
    assert later.part("training").values["iterations"] == second.log.iterations
    names = [name for name in state.tensors if "opt_state" in name]
    assert names
    assert any(np.any(later.tensors[name] != state.tensors[name]) for name in names)
    planner = second._training._built.planner
    assert "Watched" in planner.update.__qualname__
    second.close()
    # the planner is as it was, and the state stays
    for function in (planner.update, planner.test_loss):
        assert "Watched" not in getattr(function, "__qualname__", "")
    after = second.state().part("training").values
    assert after["iterations"] == later.part("training").values["iterations"]


def no_scalars(state: State) -> str:
    """As a number of another shape."""
    key = next(name for name in state.tensors if name.endswith("found/every"))
    state.tensors[key] = np.zeros(2)
    return "can only convert an array of size 1"


def other_shapes(state: State) -> str:
    """As parameters of another policy."""
    key = next(name for name in state.tensors if name.endswith("loop/params/0"))
    state.tensors[key] = state.tensors[key][:, :1]
    return "where the planner has"


@pytest.mark.long
@pytest.mark.parametrize("damage", [no_scalars, other_shapes])
@pytest.mark.parametrize("make", [make_gradient])
def test_a_training_s_state_that_does_not_fit_costs_the_state_only(
    compiled, arena, make, damage, caplog
):
    caplog.set_level("INFO")
    first = begun(make(arena))
    first.work(time.monotonic())
    state = through_json(first.state())
    first.close()
    cause = damage(state)
    second = make(in_arena(compiled))
    second.restore(state)
    begun(second)
    for _ in range(2):  # in the first slice that is seen
        second.work(time.monotonic() + 0.5)
        second.await_program(time.monotonic() + FOREVER)
    assert "its state is left out: " in caplog.text
    assert cause in caplog.text
    assert second.log.iterations > 0
    assert not second.is_exhausted
    second.close()


def test_phases_that_are_over_are_counted_in_the_first_slice_of_the_next(arena, monkeypatch):
    seen = []

    class Ended:
        """A training that ends after five iterations."""

        train_seconds = 0.0
        has_ended = False

        def __init__(self, *given: object) -> None:
            """Trains nothing."""

        def advance(self, seconds: float) -> None:
            values = arm.state().values
            seen.append((values["ended"], values["iterations"]))
            self.train_seconds, self.has_ended = 1.0, True

        def state(self) -> TrainingState:
            return TrainingState({}, {"iterations": 5})

        def result(self, seconds: float) -> SimpleNamespace:
            return SimpleNamespace(
                best_params=arena.noop,
                last_params=arena.noop,
                policy_hyperparams={},
                iterations=5,
                restart=0,
                status="ended",
                not_finite=0,
                lost_sensitivities=0,
            )

        def compile(self) -> None:
            """Compiles nothing."""

        def limit(self, seconds: float) -> None:
            """Has no time of its own."""

        def close(self) -> None:
            """Leaves nothing."""

    monkeypatch.setattr(gradient, "Training", Ended)
    arm = begun(make_gradient(arena))
    for _ in range(3):
        arm.work(time.monotonic() + FOREVER)
    arena.planner.vary_restarts()
    assert seen == [(0, 0), (1, 5), (2, 10)]
    assert arm.state().values["ended"] == len(arm.phases) - 1
