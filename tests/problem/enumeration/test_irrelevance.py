"""States that are joined, for they differ only in what no longer matters."""

import numpy as np
import pytest
from helpers import toy_mdps as toys

from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.problem.enumeration import irrelevance
from mdpo_rddl.problem.enumeration.irrelevance import find_merges, merged
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits
from mdpo_rddl.problem.enumeration.model import ground_model
from mdpo_rddl.problem.enumeration.states import enumerate_states
from mdpo_rddl.problem.load import load_problem


def limits():
    return EnumerationLimits(seconds=60)


def enumerated(problem):
    return enumerate_states(ground_model(problem, limits()), limits())


def state(model, **true):
    """A packed state in which the fluents have these places."""
    values = [place in true[name] for name, place in model.variables]
    return model.packing.encode_all(values)


def test_what_lies_behind_on_a_road_without_a_way_back_does_not_matter(tmp_path):
    model = ground_model(toys.one_way(tmp_path, 1, 4, 9), limits())
    merges = find_merges(model, limits())
    all_coins = state(model, at={(0, 2)}, coin={(0,), (1,), (2,), (3,)})
    found = merged(all_coins[np.newaxis], merges)[0]
    np.testing.assert_array_equal(found, state(model, at={(0, 2)}, coin={(2,), (3,)}))


def test_each_of_several_objects_has_a_place(tmp_path):
    # what one has passed matters as long as the other may come there
    model = ground_model(toys.one_way(tmp_path, 2, 3, 6), limits())
    merges = find_merges(model, limits())
    coins = {(0,), (1,), (2,)}
    apart = state(model, at={(0, 2), (1, 0)}, coin=coins)
    np.testing.assert_array_equal(merged(apart[np.newaxis], merges)[0], apart)


@pytest.mark.parametrize(("places", "horizon"), [(5, 9), (3, 6)])
def test_joined_states_are_fewer_and_worth_the_same(tmp_path, monkeypatch, places, horizon):
    problem = toys.one_way(tmp_path, 1, places, horizon)
    joined, value = enumerated(problem), find_optimum(problem, 60.0).value
    monkeypatch.setattr(irrelevance, "_MOST_WORK", 0)
    apart = enumerated(problem)
    assert not apart.merges
    assert len(joined.states) < len(apart.states)
    assert find_optimum(problem, 60.0).value == pytest.approx(value)


def test_what_a_number_needs_matters_as_long_as_the_number_does(tmp_path):
    assert find_optimum(toys.counter(tmp_path, 3), 60.0).value == 3.0


def test_what_follows_a_joined_state_is_in_the_table(tmp_path):
    # once the second is true the third does not matter, nor then does it make the first true
    solution = find_optimum(toys.chain(tmp_path, 6), 60.0)
    policy = solution.policy()
    assert len(solution.table.merges) > 0
    assert policy.evaluate(episodes=2, seed=0).mean == pytest.approx(solution.value)
    assert policy.misses == 0
    assert solution.value == pytest.approx(5 - 0.125)


@pytest.mark.parametrize("make", [toys.chain, toys.walk])
def test_merging_again_changes_nothing(tmp_path, make):
    model = ground_model(make(tmp_path, 6), limits())
    merges = find_merges(model, limits())
    bits = np.random.default_rng(0).integers(2, size=(200, len(model.variables)))
    states = np.stack([model.packing.encode_all(each) for each in bits.tolist()])
    once = merged(states, merges)
    assert np.any(once != states)
    np.testing.assert_array_equal(merged(once, merges), once)
    # nor does their order
    np.testing.assert_array_equal(merged(states, merges[::-1]), once)


def test_a_policy_of_joined_states_plays_all_of_them(tmp_path):
    solution = find_optimum(toys.one_way(tmp_path, 1, 5, 9), 60.0)
    policy = solution.policy()
    evaluation = policy.evaluate(episodes=200, seed=1)
    assert policy.misses == 0
    assert evaluation.mean == pytest.approx(solution.value, abs=4 * evaluation.std / 200**0.5)


def test_a_large_triangle_of_one_way_roads_is_solved():
    # a tyre that lies behind makes no difference; with it the states are too many
    solution = find_optimum(load_problem("TriangleTireworld_MDP_ippc2014", "9"), 120.0)
    assert solution.optimum.states < 1000
    assert -40 < solution.value < -3.85
