"""Next values that are drawn together: their laws against the exact environment's draws."""

from collections import Counter

import numpy as np
import pytest
from helpers.toys import problem_from

from mdpo_rddl.auto.search.optimum import find_optimum
from mdpo_rddl.problem.enumeration import afterstates, levels
from mdpo_rddl.problem.enumeration.factored import enumerate_factored
from mdpo_rddl.problem.enumeration.graph import Graph, Kind
from mdpo_rddl.problem.enumeration.joint import combinations, joint_law
from mdpo_rddl.problem.enumeration.laws import Laws
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import ground_model
from mdpo_rddl.problem.enumeration.states import Search, enumerate_states
from mdpo_rddl.problem.load import load_problem, make_environment

# two draws of which one depends on the other, a next value that another one reads, a switch, an
# object that is drawn and one that the state names
_CARDS = """domain cards {
    types { item : { @i1, @i2, @i3 }; suit : { @red, @black, @none }; };
    pvariables {
        VALUE(item) : { non-fluent, int, default = 1 };
        CHANCE(item) : { non-fluent, real, default = 0.5 };
        card : { interm-fluent, item };
        lucky : { interm-fluent, bool };
        worth : { interm-fluent, int };
        total : { state-fluent, int, default = 0 };
        last : { state-fluent, item, default = @i1 };
        won : { state-fluent, bool, default = false };
        seen(item) : { state-fluent, bool, default = false };
        alone : { state-fluent, bool, default = false };
        shade : { state-fluent, suit, default = @none };
        take : { action-fluent, bool, default = false };
    };
    cpfs {
        card = Discrete_{?i : item}[CHANCE(?i)];
        lucky = if (card == @i2) then Bernoulli(0.25) else false;
        worth = VALUE(card) + lucky;
        total' = if (take) then total + worth else total;
        last' = card;
        won' = if (take) then Bernoulli(0.5) else lucky;
        seen'(?i) = seen(?i) | (won' ^ (last == ?i));
        alone' = Bernoulli(0.75);
        shade' = switch (last) { case @i1 : @red, case @i2 : @black, default : @none };
    };
    reward = VALUE(last) * won' + total' - seen(last);
}
non-fluents nf { domain = cards;
    non-fluents { VALUE(@i2) = 2; VALUE(@i3) = 5; CHANCE(@i1) = 0.25; CHANCE(@i3) = 0.25; };
}
instance i { domain = cards; non-fluents = nf; max-nondef-actions = 1; horizon = 3;
    discount = 1.0; }
"""


def limits() -> EnumerationLimits:
    """Their time begins with them."""
    return EnumerationLimits(seconds=60)


@pytest.fixture(scope="module")
def cards():
    return problem_from(_CARDS)


@pytest.fixture(scope="module")
def model(cards):
    return ground_model(cards, limits())


def test_variables_that_share_a_draw_are_a_group(model):
    names = [
        {f"{name}{''.join(map(str, place))}" for name, place in map(model.variables.__getitem__, g)}
        for g in model.groups
    ]
    assert names == [{"total", "last", "won", "seen0", "seen1", "seen2"}]
    for action in model.actions:
        for number, law in enumerate(action.laws):
            assert bool(law) != (number in model.groups[0])
    with pytest.raises(NotEnumerableError, match="random bools"):
        enumerate_factored(model, limits())


@pytest.mark.parametrize("take", [False, True])
def test_joint_probabilities_are_those_of_the_environment(cards, model, take):
    found = enumerate_states(model, limits())
    np.testing.assert_allclose(found.transitions.sum(axis=1), 1.0)
    (row,) = [
        row
        for row in range(*found.first_row[:2])
        if found.model.actions[found.action[row]].assignment["take", ()] == take
    ]
    chances = found.transitions[found.afterstate[row]].toarray().ravel()
    expected: Counter = Counter()
    for state in np.flatnonzero(chances):
        values = [
            int(model.packing.decode(number, found.states[[state]])[0])
            for number in range(len(model.variables))
        ]
        expected[tuple(values)] += chances[state]
    env = make_environment(cards)
    drawn, episodes = Counter(), 2000
    env.reset(seed=0)
    for _ in range(episodes):
        env.reset()
        env.step({"take": take})
        state = env.sampler.subs
        drawn[tuple(int(np.asarray(state[name])[place]) for name, place in model.variables)] += 1
    assert set(drawn) <= set(expected)
    for values, chance in expected.items():
        error = np.sqrt(chance * (1 - chance) / episodes)
        assert abs(drawn[values] / episodes - chance) < 5 * error


def test_the_optimum_is_what_its_policy_returns(cards):
    solution = find_optimum(cards, 60.0, 4.0)
    played = solution.policy(0).evaluate(episodes=1500)
    error = np.std(played.returns) / np.sqrt(len(played.returns))
    assert abs(played.mean - solution.value) < 4 * error


@pytest.mark.long
@pytest.mark.parametrize(
    ("problem", "optimum"), [("Blackjack_arcade", 0.43), ("Knapsack_or", 1198.1)]
)
def test_problems_of_which_all_next_values_read_one_card(problem, optimum):
    solution = find_optimum(load_problem(problem, "0"), 60.0, 4.0)
    assert solution.value == pytest.approx(optimum, rel=0.01)
    played = solution.policy(0).evaluate(episodes=300)
    error = np.std(played.returns) / np.sqrt(300)
    assert abs(played.mean - solution.value) < 4 * error


def test_a_switch_on_a_draw_is_refused():
    switch = _CARDS.replace("switch (last)", "switch (NEXT(Discrete_{?i : item}[CHANCE(?i)]))")
    fluent = "NEXT(item) : { non-fluent, item, default = @i1 };"
    problem = problem_from(switch.replace("card : {", f"{fluent} card : {{", 1))
    with pytest.raises(NotEnumerableError, match="a switch on a draw"):
        ground_model(problem, limits())


def test_samples_are_drawn_as_the_list_of_successors_says(model):
    search = Search(model, limits())
    search.expand(model.initial[np.newaxis])
    after = search.after_index.states
    states, probability = search.afterstates.sample(
        np.repeat(after[:1], 4000, axis=0), np.random.default_rng(0)
    )
    (draws,) = search.afterstates.draw(after[:1])
    known = {
        tuple(state): chance for state, chance in zip(draws.states, draws.probability, strict=True)
    }
    assert len(known) == len(draws.states) == search.afterstates.outcomes(after[:1])[0]
    for state, count in Counter(map(tuple, states)).items():
        assert abs(count / 4000 - known[state]) < 5 * np.sqrt(known[state] / 4000)
    np.testing.assert_allclose([known[tuple(state)] for state in states], probability)


def test_a_leaf_that_reads_another_one_is_drawn_after_it():
    graph = Graph()
    laws, x, y = Laws(graph), *(graph.leaf(Kind.DRAWN, name, True) for name in "xy")
    half = laws.bernoulli(graph.constant(0.5))
    drawn = {y: laws.bernoulli(graph.make("*", x, graph.constant(0.25))), x: half}
    both = combinations(graph, [graph.make("and", x, y)], drawn)
    chance = {
        (graph.values[values[x]], graph.values[values[y]]): graph.values[probability]
        for values, probability in both
    }
    assert chance == {(True, True): 0.125, (True, False): 0.375, (False, False): 0.5}
    own = [((laws.certain(x)), True), (laws.certain(graph.make("+", x, y)), False)]
    law = joint_law(graph, own, drawn)
    found = {
        tuple(graph.values[v] for v in each.values): graph.values[each.probability] for each in law
    }
    assert found == {(True, 2): 0.125, (True, 1): 0.375, (False, 0): 0.5}


def test_many_draws_that_are_read_together_are_refused():
    graph = Graph()
    leaves = [graph.leaf(Kind.DRAWN, number, True) for number in range(13)]
    half = Laws(graph).bernoulli(graph.constant(0.5))
    with pytest.raises(NotEnumerableError, match="read together"):
        combinations(graph, [graph.make("and", *leaves)], dict.fromkeys(leaves, half))
    ints = [(Laws(graph).apply("*", [half, Laws(graph).certain(graph.constant(2))]), False)] * 11
    with pytest.raises(NotEnumerableError, match="1,024 values together"):
        joint_law(graph, ints, {})


def test_distributions_that_are_looked_at_in_parts_get_the_same_levels(cards, model, monkeypatch):
    whole = enumerate_states(model, limits())
    monkeypatch.setattr(afterstates, "_NUMBERS_TOGETHER", 1)
    parts = enumerate_states(ground_model(cards, limits()), limits())
    # a level's number, and with it the order of the states, is that of its first part
    assert sorted(map(tuple, whole.states)) == sorted(map(tuple, parts.states))
    assert whole.transitions.nnz == parts.transitions.nnz
    np.testing.assert_allclose(parts.transitions.sum(axis=1), 1.0)
    monkeypatch.setattr(levels, "_MAX_NUMBERS", 100)
    with pytest.raises(NotEnumerableError, match="many distributions of many values"):
        enumerate_states(model, limits())
