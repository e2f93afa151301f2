"""A search by trials goes on in another process exactly as it would have."""

import json

import numpy as np
import pytest
from helpers import toy_mdps as toys
from helpers.clocks import Ticking
from helpers.toys import toy

from mdpo_rddl.auto.common.state import UNFIT, State
from mdpo_rddl.auto.search.trials.playing import play
from mdpo_rddl.auto.search.trials.trials import TrialSearch
from mdpo_rddl.policy.container import read_container, write_container
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits
from mdpo_rddl.problem.enumeration.model import ground_model

LIMITS = EnumerationLimits(seconds=1e9, clock=Ticking())
GROWING = (
    *("depth", "visits", "first_row", "row_count", "action", "reward", "afterstate", "tried"),
    *("idle", "origin", "next", "probability", "_is_complete"),
)


@pytest.fixture(scope="module", autouse=True)
def _few_trials():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mdpo_rddl.auto.search.trials.trials._TRIALS", 8)
        yield


def walking(folder):
    """States that are joined, of two words."""
    return toys.walk(folder, 6)


@pytest.fixture(scope="module", params=["quest", "walk"])
def model(request, tmp_path_factory):
    if request.param == "quest":
        return ground_model(toy("quest"), LIMITS)
    return ground_model(walking(tmp_path_factory.mktemp("walk")), LIMITS)


def new(model, now: float = 0.0) -> TrialSearch:
    return TrialSearch(model, LIMITS, 3, Ticking(1.0, now))


def through_a_file(state: State, folder) -> State:
    text = {"format": "t", "values": json.dumps(dict(state.values))}
    write_container(folder / "state", dict(state.tensors), text)
    text, tensors = read_container(folder / "state", ("t",))
    return State(tensors, json.loads(text["values"]))


def restored(model, state: State, now: float = 0.0) -> TrialSearch:
    search = new(model, now)
    for _ in search.restoring(state):
        pass
    return search


def assert_same(one: TrialSearch, other: TrialSearch) -> None:
    mine, its = one.explored, other.explored
    for index in ("index", "after_index", "_drawn"):
        np.testing.assert_array_equal(getattr(mine, index).states, getattr(its, index).states)
    for name in GROWING:
        np.testing.assert_array_equal(getattr(mine, name).values, getattr(its, name).values)
    assert mine.afterstates.levels() == its.afterstates.levels()
    for each, same in zip(one._greedy, other._greedy, strict=True):
        np.testing.assert_array_equal(each, same)
    np.testing.assert_array_equal(one._rarity, other._rarity)
    assert (one.batches, one._inductions) == (other.batches, other._inductions)


@pytest.mark.parametrize("together", [1, 100, 10**6])
def test_it_goes_on_exactly_as_it_would_have(model, tmp_path, monkeypatch, together):
    monkeypatch.setattr("mdpo_rddl.auto.search.trials.explored._ROWS_TOGETHER", together)
    search = new(model)
    search.work(25.0)
    # what is played sees distributions that the search has not
    play(search.explored, search.found(0.0), 8, 0)
    state = through_a_file(search.state(), tmp_path)
    again = restored(model, state, search._clock.now)
    assert_same(search, again)
    size, batches = search.explored.size, search.batches
    for each in (search, again):
        each.work(160.0)
    assert search.explored.size >= size
    assert search.batches > batches
    assert_same(search, again)
    assert again.found(0.9).value == search.found(0.9).value


def test_it_is_small(model):
    search = new(model)
    search.work(60.0)
    state, explored = search.state(), search.explored
    assert state.tensors["explored/tried"].dtype.itemsize < 4
    assert not {"reward", "action", "afterstate"} & {n.rpartition("/")[2] for n in state.tensors}
    assert state.tensors["policy/states"].size < search._greedy.rows.size
    assert len(state.tensors["explored/states"]) == explored.size


def test_what_an_interruption_has_left_half_done_is_left_out(model, monkeypatch):
    search = new(model)
    rows, calls = search.explored.maker.rows, iter(range(2))

    def interrupted(states):
        if next(calls, None) is None:
            raise KeyboardInterrupt
        return rows(states)

    monkeypatch.setattr(search.explored.maker, "rows", interrupted)
    with pytest.raises(KeyboardInterrupt):
        search.work(100.0)
    explored = search.explored
    assert explored.size > explored.depth.count > 1
    again = restored(model, search.state())
    assert again.explored.size == explored.depth.count
    again.work(60.0)
    assert again.explored.size >= explored.size


def larger(name: str, by: int = 1):
    def change(state: State) -> None:
        tensor = state.tensors[name].copy()
        tensor[-1] += by
        state.tensors[name] = tensor

    return change


def first_of(name: str, count: int):
    def change(state: State) -> None:
        state.tensors[name] = state.tensors[name][:count]

    return change


def other_value(name: str, value: object, part: str | None = None):
    def change(state: State) -> None:
        (state.values if part is None else state.values[part])[name] = value

    return change


@pytest.mark.parametrize(
    "change",
    [
        larger("explored/states", 2**60),  # no variable has these bits
        larger("explored/batches"),
        larger("explored/depth", 200),
        larger("explored/drawn", 2**60),
        larger("explored/probability", 1),
        larger("policy/states", 200),
        larger("policy/choices", 200),
        larger("policy/counts"),
        larger("explored/levels/lengths"),
        larger("explored/levels/variables", 200),
        first_of("explored/states", 3),
        first_of("explored/tried", 3),
        first_of("explored/visits", 3),
        first_of("policy/popularity", 1),
        first_of("explored/levels/numbers", 1),
        other_value("searching", float("nan")),
        other_value("batches", -1),
        other_value("generator", {"bit_generator": "PCG64"}),
        other_value("known", 10**9, "policy"),
        other_value("known", 0, "policy"),
        other_value("value", float("inf"), "policy"),
        lambda state: state.tensors.pop("explored/drawn"),
        lambda state: state.values.pop("policy"),
    ],
)
def test_a_changed_state_is_refused(model, change):
    search = new(model)
    search.work(25.0)
    state = search.state()
    change(state)
    with pytest.raises(UNFIT):
        restored(model, state)


def test_more_states_than_a_search_may_have_are_refused_before_they_are_looked_at(
    model, monkeypatch
):
    search = new(model)
    search.work(25.0)
    state = search.state()
    monkeypatch.setattr("mdpo_rddl.auto.search.trials.trials._MOST_STATES", 2)
    monkeypatch.setattr("mdpo_rddl.auto.search.trials.trials._MOST_TOGETHER", 1)
    with pytest.raises(ValueError, match="it has more than 2 states"):
        next(new(model).restoring(state))
