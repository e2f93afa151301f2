"""One object's weights at a time."""

from types import SimpleNamespace

import numpy as np
import pytest

from mdpo_rddl.auto.search.object_wise import ObjectWise, objects_of

RDDL = SimpleNamespace(
    action_fluents=["turn", "push", "brake"],
    variable_params={"turn": ["ship"], "push": ["ship", "side"], "brake": []},
    type_to_objects={"ship": ["a", "b"], "side": ["l", "r", "m"]},
)
PARAMS = {
    "shared": {"turn": np.zeros(2), "push": np.zeros(1), "brake": np.zeros(1)},
    "own": {
        "turn": {"bias": np.zeros(2), "pairs with wind": np.zeros((2, 2))},
        "push": {"bias": np.zeros((2, 3))},
        "brake": {"bias": np.zeros(()), "pairs with wind": np.zeros(2)},
    },
    "plan": {},
}
# two weights of each of eight objects, and a shared one
OBJECTS = np.array([-1, *np.repeat(np.arange(8), 2)])
POPULATION = 32


def valleys(vectors):
    """Of each weight a local optimum at zero, where all begin, and the best at half."""
    near, far = np.square(vectors), np.square(vectors - 0.5)
    return -np.minimum(4.0 * near + 0.2, far).sum(axis=1)


def search(population=POPULATION, seed=1):
    return ObjectWise(np.zeros(17), OBJECTS, population, seed)


def counted(count):
    """Has time for so many questions."""
    left = iter(range(count))
    return lambda: next(left, None) is not None


def test_weights_are_of_the_object_that_an_action_has_first():
    names = {"bias": [0, 1], "pairs with wind": [0, 0, 1, 1]}
    turn = [*names["bias"], *names["pairs with wind"]]
    # as a tree's leaves are: by name, "own" first
    brake, push = [2, 2, 2], [0, 0, 0, 1, 1, 1]
    assert objects_of(RDDL, PARAMS).tolist() == [*brake, *push, *turn, -1, -1, -1, -1]


@pytest.mark.parametrize("population", [POPULATION, 8])
def test_each_object_leaves_its_local_optimum(population):
    found = search(population)
    found.run(lambda number, vectors: valleys(vectors), counted(10_000))
    # the shared weight stays
    assert found.best[0] == 0.0
    reached, start = valleys(found.best[np.newaxis])[0], valleys(np.zeros((1, 17)))[0]
    assert found.gained == pytest.approx(reached - start)
    # all but the shared one are near the best
    assert start == pytest.approx(-3.4)
    assert reached > -0.5


def test_where_nothing_gains_two_rounds_are_the_last():
    found = search()
    found.run(lambda number, vectors: -np.abs(vectors).sum(axis=1), counted(10_000))
    # of eight objects 128 changes, which are not tested once more
    assert (found.iterations, found.gained) == (2 * 5, 0.0)
    assert found.round_populations == 5 + 4
    assert not np.any(found.best)


def test_changes_of_a_round_meet_the_same_rollouts_and_tests_meet_others():
    numbers = []

    def evaluate(number, vectors):
        numbers.append(number)
        assert vectors.shape == (POPULATION, 17)
        return valleys(vectors)

    found = search()
    found.run(evaluate, counted(1 + 5))
    assert numbers == [0] * 5 + [5, 6, 7, 8]
    assert found.gained > 0.0


def test_luck_is_no_gain():
    random = np.random.default_rng(0)
    accepted = 0
    for seed in range(20):
        found = search(seed=seed + 1)
        found.run(lambda number, vectors: random.normal(size=len(vectors)), counted(1 + 5))
        accepted += found.gained > 0.0
    assert accepted < 5


def test_where_time_ends_in_a_round_what_was_tried_counts():
    found = search()
    found.run(lambda number, vectors: valleys(vectors), counted(1 + 2))
    # a population has 31 changes: those of two objects at least
    assert found.iterations == 2 + 4
    changed = set(OBJECTS[found.best != 0.0].tolist())
    assert 1 <= len(changed) <= 4
    found = search()
    found.run(lambda number, vectors: valleys(vectors), counted(1))
    assert (found.iterations, found.gained) == (0, 0.0)


def test_what_is_no_number_is_not_taken():
    found = search()

    def evaluate(number, vectors):
        lost = np.any(vectors > 0.3, axis=1)
        return np.where(lost, np.nan, valleys(vectors))

    found.run(evaluate, counted(10_000))
    assert np.all(found.best <= 0.3)
    assert np.isfinite(found.gained)


def test_of_many_objects_a_round_tries_some():
    found = ObjectWise(np.zeros(1000), np.arange(1000), POPULATION, 1)
    found.run(lambda number, vectors: -np.abs(vectors).sum(axis=1), counted(10_000))
    assert found.round_populations == 17 + 4
    assert found.iterations == 2 * 17
