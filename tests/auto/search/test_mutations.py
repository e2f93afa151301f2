"""Plans as arrays, and their mutations."""

import numpy as np
import pytest

from mdpo_rddl.auto.search.mutations import _rolled, layout_of, mutants, random_values

HORIZON = 12
PLAN = {"push": np.zeros((HORIZON, 2, 3)), "on": np.zeros((HORIZON, 4))}
LAYOUT = layout_of(PLAN, ["on"])


def generator(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_a_layout_goes_there_and_back():
    assert LAYOUT.is_bool.tolist() == [False] * 6 + [True] * 4
    random = generator()
    plan = {name: random.normal(size=np.shape(part)) for name, part in PLAN.items()}
    vector = LAYOUT.vector(plan)
    assert vector.shape == (HORIZON, 10)
    for name, part in LAYOUT.tree(vector).items():
        np.testing.assert_allclose(part, plan[name], rtol=1e-6)
    assert LAYOUT.tree(vector[np.newaxis])["push"].shape == (1, HORIZON, 2, 3)


def test_mutants_differ_in_a_few_places_and_leave_their_parents_alone():
    parents = generator(1).uniform(-1.0, 1.0, (3, HORIZON, 10)).astype(np.float32)
    kept = parents.copy()
    children = mutants(parents, 200, LAYOUT, generator())
    np.testing.assert_array_equal(parents, kept)
    distance = np.abs(children[:, np.newaxis] - parents).sum(axis=(2, 3)).min(axis=1)
    assert np.count_nonzero(distance) > 150
    # most changes concern one action, not all ten
    touched = [
        min(np.count_nonzero((child != parent).any(axis=0)) for parent in parents)
        for child in children
    ]
    assert np.median(touched) <= 3
    assert max(touched) > 3


def test_values_of_bools_are_to_do_it_or_not():
    assert set(random_values(True, 50, generator())) == {-1.0, 1.0}
    numbers = random_values(False, 500, generator())
    assert np.max(np.abs(numbers)) == 1.0
    assert len(np.unique(numbers)) > 100


@pytest.mark.parametrize("steps", [0, 1, 2, 3, 7])
def test_steps_are_rolled_as_numpy_rolls_them(steps):
    values = np.arange(2 * steps).reshape(steps, 2)
    for shift in range(-8, 9):
        np.testing.assert_array_equal(_rolled(values, shift), np.roll(values, shift, axis=0))
