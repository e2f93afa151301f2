"""A table in compiled rollouts plays what it plays step by step, and can be thought beyond."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from helpers import toy_mdps as toys
from helpers.clocks import Ticking
from helpers.mistakes import one_line
from helpers.x64 import enable_x64

from mdpo_rddl.policy.lookahead.choice import OPTIMAL, choose
from mdpo_rddl.policy.lookahead.table_lookup import TableLookup
from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.policy.table import ActionTable, Estimate
from mdpo_rddl.policy.table_policy import TablePolicy
from mdpo_rddl.problem.enumeration.irrelevance import Merge, merged
from mdpo_rddl.problem.enumeration.packing import Packing, Place, keys

HORIZON = 5
GUESS = Estimate(value=0.0, error=1.0, episodes=2, missed=0.0, states=1)


@pytest.fixture(scope="module")
def optimal(tmp_path_factory):
    return find_optimum(toys.walk(tmp_path_factory.mktemp("walk"), HORIZON), 30).policy(seed=5)


@pytest.fixture(scope="module")
def assert_same(optimal):
    lookup = TableLookup(optimal.table)
    play = jax.jit(lookup.policy)

    def at(state, steps=range(HORIZON)):
        for step in steps:
            expected = optimal(step, state)
            found = play(None, lookup.arrays, {}, step, state, {})
            assert found.keys() == expected.keys()
            for name, value in expected.items():
                np.testing.assert_array_equal(found[name], value)

    return at


def test_the_same_actions_in_all_states_at_all_steps(assert_same):
    for cell in range(3):
        for sky in range(2):
            assert_same({"at": np.arange(3) == cell, "sky": np.array([sky])})


def test_unknown_states_get_the_no_op(optimal, assert_same):
    misses = optimal.misses
    assert_same({"at": np.zeros(3, bool), "sky": np.array([0])}, range(1))
    # a number that is none of the objects
    assert_same({"at": np.arange(3) == 1, "sky": np.array([7])}, range(1))
    assert optimal.misses == misses + 2


@pytest.mark.parametrize("has_64_bits", [False, True])
def test_states_of_several_words_numbers_and_merges(optimal, has_64_bits):
    random, count = np.random.default_rng(0), 300
    packing = Packing(
        (
            Place(0, 0, 1, 0),
            Place(0, 1, 16, 1 << 15),
            # beyond the middle of a word
            Place(0, 20, 16, 1 << 15),
            Place(0, 36, 5, 0),
            Place(1, 0, 16, 1 << 15),
            Place(1, 16, 1, 0),
        )
    )
    variables = random.integers(-3, 3, (count, 6))
    variables[:, [0, 5]] = random.integers(2, size=(count, 2))
    variables[:, 3] = random.integers(32, size=count)
    keep = [np.uint64(2**64 - 1) ^ packing.places[2].mask, packing.places[5].mask]
    # where bools of both words are so and so, and where the one of the second word is false
    first, last = packing.places[0].mask, packing.places[5].mask
    rows = [[[first, last], [0, last], keep], [[0, last], [0, 0], keep]]
    # as in earlier files: the last one reads what the one before it clears
    whole = np.uint64(2**64 - 1)
    rows += [[[0, last], [0, last], [whole ^ first, whole]]]
    rows += [[[first, 0], [0, 0], [whole ^ packing.places[1].mask, whole]]]
    merges = [Merge(*np.array(row, np.uint64)) for row in rows]
    packed = merged(np.stack([packing.encode_all(row) for row in variables.tolist()]), merges)
    states = packed[np.unique(keys(packed), return_index=True)[1]]
    runs = random.integers(1, 4, len(states))
    table = ActionTable(
        places=np.array(packing.places, np.int64),
        merges=np.array(merges),
        states=states,
        first_run=np.concatenate([[0], np.cumsum(runs)]),
        until_step=np.concatenate([2 * np.arange(each) + 1 for each in runs]),
        action=random.integers(1, 50, runs.sum()),
        actions={"number": np.arange(50)},
        fluents=("all",),
        objects={},
    )
    policy, lookup = TablePolicy(optimal.problem, table, GUESS, 0), TableLookup(table)
    play = jax.jit(jax.vmap(lookup.policy, (None, None, None, 0, 0, None)))
    seen = np.concatenate([variables, variables + np.array([0, 9, 0, 0, 0, 0])])
    steps = random.integers(7, size=len(seen))
    with enable_x64(has_64_bits):
        found = play(None, lookup.arrays, {}, steps, {"all": seen}, {})["number"]
    played = zip(steps.tolist(), seen, strict=True)
    expected = [policy._actions(s, {"all": row[np.newaxis]})["number"][0] for s, row in played]
    np.testing.assert_array_equal(found, expected)
    assert 0 in expected
    assert len(set(expected)) > 20
    assert len(lookup.arrays.merges) == 2
    for part, wrong in ((0, packing.places[3].mask), (2, whole ^ np.uint64(1 << 36))):
        merges = table.merges.copy()
        merges[0, part, 0] = wrong
        with pytest.raises(ValueError, match="joined by what is no bool"):
            TableLookup(replace(table, merges=merges))


@pytest.mark.long
def test_a_table_without_some_states_is_thought_beyond(optimal):
    """It knows what to do at the start only, and stays where it comes to then."""
    packing = Packing(tuple(Place(*place) for place in optimal.table.places.tolist()))
    start = packing.encode_all([1, 0, 0, 0])
    (at,) = np.flatnonzero(np.all(optimal.table.states == start, axis=1))
    first, last = optimal.table.first_run[at : at + 2]
    table = replace(
        optimal.table,
        states=optimal.table.states[[at]],
        first_run=np.array([0, last - first]),
        until_step=optimal.table.until_step[first:last],
        action=optimal.table.action[first:last],
    )
    policy = TablePolicy(optimal.problem, table, GUESS, 0)
    choice = choose(policy, 0.5, clock=Ticking(0.01))
    assert choice.policy is not None
    assert policy.misses == 0
    gains = choice.policy.evaluate(episodes=20).returns - policy.evaluate(episodes=20).returns
    assert gains.mean() > 2.0 * gains.std() / np.sqrt(20)


@pytest.mark.long
def test_a_table_that_nothing_beats_is_thought_beyond_where_it_knows_nothing(optimal):
    choice = choose(TablePolicy(optimal.problem, optimal.table, GUESS, 0), 0.5, clock=Ticking(0.01))
    assert not any(trial.pays for trial in choice.trials)
    assert choice.policy is not None
    assert choice.policy.label == "first actions, in unknown states"
    for cells in (np.arange(3) == 0, np.zeros(3, bool)):
        choice.policy.decide(0, {"at": cells, "sky": np.array([0])})
    assert [decision.calls > 0 for decision in choice.policy.decisions] == [False, True]


def test_nothing_is_tried_where_the_optimum_is_proven(optimal):
    choice = choose(optimal, 0.5, clock=Ticking(0.01))
    assert choice.policy is None
    assert (choice.note, choice.trials) == (OPTIMAL, [])
    assert optimal.with_decision_seconds(0.5) is optimal
    assert "must be a number above 0" in one_line(lambda: optimal.with_decision_seconds(0.0))


def test_what_does_not_fit_into_compiled_code_is_said(optimal):
    far = replace(optimal.table, until_step=np.full_like(optimal.table.until_step, 2**31 - 2))
    choice = choose(TablePolicy(optimal.problem, far, GUESS, 0), 0.5, clock=Ticking(0.01))
    assert choice.note == "the table is too large"
    twice = replace(optimal.table, states=np.repeat(optimal.table.states[:1], 2, axis=0))
    choice = choose(TablePolicy(optimal.problem, twice, GUESS, 0), 0.5, clock=Ticking(0.01))
    assert choice.note == "the table has a state twice"
