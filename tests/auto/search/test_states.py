"""What is searched with goes on in another process as if nothing had stopped it."""

import json
from collections.abc import Callable

import numpy as np
import pytest
from helpers.clocks import Ticking

from mdpo_rddl.auto.common.state import UNFIT, State
from mdpo_rddl.auto.search import archive as archives
from mdpo_rddl.auto.search.archive import Archive
from mdpo_rddl.auto.search.cma import Adaptation, Sampling
from mdpo_rddl.auto.search.evolution import Breeding, Evaluation, Goal, evolve
from mdpo_rddl.auto.search.mutations import layout_of

TARGET = np.array([1.0, -2.0, 0.5, 3.0])
HORIZON = 6
LAYOUT = layout_of({"push": np.zeros((HORIZON, 2)), "on": np.zeros((HORIZON, 1))}, ["on"])


def distance(iteration: int, vectors: np.ndarray) -> np.ndarray:
    return -np.sum((vectors - TARGET) ** 2, axis=1) + iteration


def through_json(state: State) -> State:
    """As it comes out of a file."""
    tensors = {name: np.array(tensor) for name, tensor in state.tensors.items()}
    return State(tensors, json.loads(json.dumps(dict(state.values))))


def adaptation(separable: bool, size: int = 4) -> Adaptation:
    sampling = Sampling(sigma=0.5, population=12, seed=1, separable=separable)
    return Adaptation(np.zeros(size), sampling, Ticking())


MAKERS: dict[str, Callable[..., Adaptation]] = {
    "full": lambda *size: adaptation(False, *size),
    "separable": lambda *size: adaptation(True, *size),
}


@pytest.mark.parametrize("name", MAKERS)
def test_a_search_goes_on_bit_for_bit(name):
    whole, first, second = (MAKERS[name]() for _ in range(3))
    whole.run(distance, 20.5)
    first.run(distance, 20.5)
    second.restore(through_json(first.state()))
    assert second.iterations == first.iterations == whole.iterations > 10
    for one in (whole, second):
        one._clock = Ticking()
        one.run(distance, 20.5)
    assert whole.iterations == second.iterations > first.iterations
    np.testing.assert_array_equal(second.mean, whole.mean)
    assert not np.array_equal(second.mean, first.mean)


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize("broken", ["size", "infinite", "sigma", "generator", "missing"])
def test_a_state_that_does_not_fit_is_refused(name, broken):
    state = through_json(MAKERS[name](*([5] if broken == "size" else [])).state())
    tensors, values = dict(state.tensors), dict(state.values)
    if broken == "infinite":
        tensors["mean"][0] = np.inf
    elif broken == "sigma":
        values["sigma"] = -1.0
    elif broken == "generator":
        values["generator"] = ["MT", 1, 2, 3]
    elif broken == "missing":
        del tensors["mean"]
    fresh = MAKERS[name]()
    with pytest.raises(UNFIT):
        fresh.restore(State(tensors, values))
    assert fresh.iterations == 0
    np.testing.assert_array_equal(fresh.mean, np.zeros(4))


@pytest.mark.parametrize(
    ("generator", "cause"),
    [
        (["MT19937", 100_000_000, 0, 0.0], "word 100000000"),
        (["MT19937", -1, 0, 0.0], "-1"),
        (["MT19937", 624, 2, 0.0], "2 times"),
        (["MT19937", 624, 1, float("nan")], "nan"),
        (["PCG64", 624, 0, 0.0], "PCG64|MT19937"),
    ],
)
def test_a_generator_at_no_place_is_refused_before_it_draws(generator, cause):
    state = through_json(adaptation(False).state())
    state.values["generator"] = generator
    with pytest.raises(ValueError, match=cause):
        adaptation(False).restore(state)


@pytest.mark.parametrize(
    ("name", "change", "cause"),
    [
        ("words", lambda words: words[:3], "words"),
        ("words", lambda words: words.astype(float), "uint32"),
        ("C", lambda matrix: matrix + np.triu(np.ones((4, 4)), 1), "not symmetric"),
        ("mean", lambda mean: mean + 2e30, "2e.30, and 1e.30 is the most"),
    ],
)
def test_arrays_that_are_no_distribution_are_refused(name, change, cause):
    state = through_json(adaptation(False).state())
    state.tensors[name] = change(state.tensors[name])
    with pytest.raises(ValueError, match=cause):
        adaptation(False).restore(state)


def test_a_distribution_in_whole_numbers_goes_on_in_real_ones():
    first, second = adaptation(False), adaptation(False)
    state = through_json(first.state())
    state.tensors["mean"] = state.tensors["mean"].astype(np.int8)
    second.restore(state)
    for one in (first, second):
        one.run(distance, 20.5)
    np.testing.assert_array_equal(second.mean, first.mean)


def filled(count: int = 3) -> Archive:
    archive = Archive(LAYOUT, {"x": (0.0, 1.0)}, seed=0)
    plans = np.random.default_rng(1).normal(size=(count, HORIZON, 3)).astype(np.float32)
    archive.add(plans, {"x": np.cumsum(plans[:, :, 0], axis=1)})
    archive.plans(5)
    return archive


def test_an_archive_comes_back_with_its_cells_and_what_was_tried_from_them():
    first, second = filled(), Archive(LAYOUT, {"x": (0.0, 1.0)}, seed=9)
    second.restore(through_json(first.state()), HORIZON)
    assert len(second) == len(first) > 3
    np.testing.assert_array_equal(second.plans(20), first.plans(20))
    plan = np.ones((1, HORIZON, 3), np.float32)
    for archive in (first, second):
        archive.add(plan, {"x": np.arange(HORIZON)[np.newaxis] * 7.0})
    assert len(second) == len(first)
    np.testing.assert_array_equal(second.plans(20), first.plans(20))


def test_an_empty_archive_comes_back_empty():
    state = through_json(Archive(LAYOUT, {"x": (0.0, 1.0)}, seed=0).state())
    second = Archive(LAYOUT, {"x": (0.0, 1.0)}, seed=0)
    second.restore(state, HORIZON)
    assert len(second) == 0


def test_of_too_many_plans_the_first_are_kept(monkeypatch):
    archive = filled(40)
    monkeypatch.setattr(archives, "_MOST_STATE_BYTES", 5 * HORIZON * 3 * 4)
    state = archive.state()
    assert len(state.tensors["plans"]) == 5
    second = Archive(LAYOUT, {"x": (0.0, 1.0)}, seed=0)
    second.restore(through_json(state), HORIZON)
    assert 0 < len(second) < len(archive)


@pytest.mark.parametrize(
    ("name", "value"), [("cell_plans", 99), ("steps", 0), ("steps", HORIZON + 1), ("taken", -1)]
)
def test_an_archive_whose_cells_lead_nowhere_is_refused(name, value):
    state = through_json(filled().state())
    state.tensors[name][0] = value
    with pytest.raises(ValueError, match="nowhere"):
        Archive(LAYOUT, {"x": (0.0, 1.0)}, seed=0).restore(state, HORIZON)


def test_an_evolution_says_after_each_iteration_which_plans_are_the_best():
    seen: list[np.ndarray] = []

    def evaluate(iteration, plans):
        return Evaluation(-np.sum((plans - 0.3) ** 2, axis=(1, 2)), dict)

    random = np.random.default_rng(0)
    breeding = Breeding(LAYOUT, 16, random, clock=Ticking(), on_generation=seen.append)
    result = evolve(evaluate, np.zeros((1, HORIZON, 3)), breeding, Goal(12.0, -np.inf))
    assert len(seen) == result.iterations > 3
    np.testing.assert_array_equal(seen[-1], result.elites)
    again = evolve(evaluate, seen[-1], breeding, Goal(24.0, -np.inf))
    assert again.best >= result.best


@pytest.mark.parametrize("name", MAKERS)
def test_what_is_wrong_with_a_state_is_said_with_its_bound(name):
    state = through_json(MAKERS[name]().state())
    state.values["sigma"] = -1.0
    with pytest.raises(ValueError, match=r"sigma is -1\.0, and not between 0 and infinity"):
        MAKERS[name]().restore(state)
