"""Enumerated states and their probabilities, against the exact environment's draws."""

import numpy as np
import pytest
from helpers import toy_mdps as toys

from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.problem.enumeration import irrelevance
from mdpo_rddl.problem.enumeration.factored import enumerate_factored
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import ground_model
from mdpo_rddl.problem.enumeration.states import Search, enumerate_states
from mdpo_rddl.problem.load import load_problem, make_environment


def enumerated(problem):
    limits = EnumerationLimits(seconds=60)
    return enumerate_states(ground_model(problem, limits), limits)


def test_probabilities_sum_to_one_and_rows_belong_to_states(tmp_path):
    found = enumerated(toys.gambler(tmp_path, 5))
    np.testing.assert_allclose(found.transitions.sum(axis=1), 1.0)
    assert len(found.states) == len(np.unique(found.states, axis=0))
    assert found.first_row[-1] == len(found.action) == len(found.reward)
    assert found.depth[0] == 0
    assert np.all(np.diff(found.depth) >= 0)


def test_a_terminal_state_has_no_rows(tmp_path):
    found = enumerated(toys.gambler(tmp_path, 5))
    capital = found.model.packing.decode(0, found.states)
    rows = np.diff(found.first_row)
    np.testing.assert_array_equal(rows == 0, (capital <= 0) | (capital >= 3))


def test_an_illegal_action_has_no_row(tmp_path):
    found = enumerated(toys.gambler(tmp_path, 5))
    capital = found.model.packing.decode(0, found.states)
    played = {
        (name, place)
        for state in np.flatnonzero(capital == 1)
        for row in range(*found.first_row[state : state + 2])
        for (name, place), on in found.model.actions[found.action[row]].assignment.items()
        if on
    }
    assert played == {("stake", ())}


def test_probabilities_are_those_of_the_environment(tmp_path):
    # the first step of a small network of computers, all left alone
    problem = load_problem("SysAdmin_MDP_ippc2011", "1", 2)
    found = enumerated(problem)
    row = found.first_row[0]
    assert found.action[row] == 0
    chances = found.transitions[found.afterstate[row]].toarray().ravel()
    env = make_environment(problem)
    names = [place[0] for _, place in found.model.variables]
    running = np.stack(
        [found.model.packing.decode(number, found.states) for number in range(len(names))]
    )
    expected = running.astype(float) @ chances
    drawn = []
    for seed in range(300):
        env.reset(seed=seed)
        drawn.append(env.step({})[0]["running"])
    error = np.sqrt(np.maximum(expected * (1 - expected), 1e-3) / 300)
    assert np.all(np.abs(np.mean(drawn, axis=0)[names] - expected) < 5 * error)


@pytest.mark.parametrize(
    ("limits", "cause"),
    [
        ({"states": 3}, "3 states"),
        ({"transitions": 2}, "2 transitions"),
        ({"actions": 1}, "1 joint actions"),
    ],
)
def test_a_limit_ends_the_enumeration(tmp_path, limits, cause):
    small = EnumerationLimits(seconds=60, **limits)
    with pytest.raises(NotEnumerableError, match=cause):
        enumerate_states(ground_model(toys.walk(tmp_path, 5), small), small)


def test_a_contraction_expects_what_the_list_of_successors_does():
    limits = EnumerationLimits(seconds=60)
    model = ground_model(load_problem("GameOfLife_MDP_ippc2011", "1"), limits)
    listed, factored = enumerate_states(model, limits), enumerate_factored(model, limits)
    packed = listed.states[:, 0].astype(int)
    assert sorted(packed) == sorted(factored.states[:, 0].astype(int))
    np.testing.assert_array_equal(factored.states[0], listed.states[0])
    value = np.random.default_rng(1).normal(size=len(packed))  # by packed state
    ours = factored.transitions @ value[factored.states[:, 0].astype(int)]
    theirs = listed.transitions @ value[packed]
    state = {key: number for number, key in enumerate(factored.states[:, 0].astype(int))}
    for number in (0, 5, 300):
        rows = slice(*listed.first_row[number : number + 2])
        start = factored.first_row[state[packed[number]]]
        stop = start + rows.stop - rows.start
        np.testing.assert_array_equal(listed.action[rows], factored.action[start:stop])
        np.testing.assert_allclose(listed.reward[rows], factored.reward[start:stop])
        expected = theirs[listed.afterstate[rows]]
        np.testing.assert_allclose(ours[factored.afterstate[start:stop]], expected, atol=1e-12)


def test_too_many_distributions_are_seen_in_a_sample_of_the_states(monkeypatch):
    # 2^16 states, of which 2,048 tell
    limits, expanded = EnumerationLimits(seconds=60), []
    model = ground_model(load_problem("Tamarisk_MDP_ippc2014", "1"), limits)
    expand = Search.expand

    def counting(search, states):
        expanded.append(len(states))
        expand(search, states)

    monkeypatch.setattr(Search, "expand", counting)
    with pytest.raises(NotEnumerableError, match="combinations of distributions"):
        enumerate_factored(model, limits)
    assert sum(expanded) == 2048


def test_a_model_with_fixed_fluents_is_not_factored(tmp_path):
    limits = EnumerationLimits(seconds=60)
    with pytest.raises(NotEnumerableError, match="random bools"):
        enumerate_factored(ground_model(toys.walk(tmp_path, 3), limits), limits)


def test_states_that_could_be_one_are_several_where_it_would_take_long_to_see_that(
    tmp_path, monkeypatch
):
    # once at the goal the weather, drawn by halves, no longer matters
    problem = toys.walk(tmp_path, 6)
    joined, value = enumerated(problem), find_optimum(problem, 60.0).value
    assert joined.merges
    monkeypatch.setattr(irrelevance, "_MOST_WORK", 0)
    found = enumerated(problem)
    assert not found.merges
    assert len(found.states) > len(joined.states)
    assert find_optimum(problem, 60.0).value == pytest.approx(value)
