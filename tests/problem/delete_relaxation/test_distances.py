"""How far rewards are: by hand, and with what the relaxation leaves out."""

import math

import numpy as np
import pytest
from helpers.clocks import Ticking
from helpers.couriers import courier, lift
from helpers.toys import problem_from

from mdpo_rddl.problem.delete_relaxation.circuit import Circuit, Literal
from mdpo_rddl.problem.delete_relaxation.conditions import conditions
from mdpo_rddl.problem.delete_relaxation.distances import FAR, Distances, Prices
from mdpo_rddl.problem.delete_relaxation.relaxed import changes_integers, relaxed
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import open_model

STEP = Prices().step
LIMITS = EnumerationLimits(1e9)
# places p0, p1, p2 and whether the parcel is held
START, LATE, THERE = (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 1)


@pytest.fixture(scope="module")
def parcel():
    model = open_model(courier(), LIMITS)
    return model, Distances(relaxed(model, LIMITS))


def cost(distances, state, prices=Prices()):  # noqa: B008  (it is frozen)
    states = np.array(state)[:, np.newaxis]
    return float(distances.to_goals(distances(states, prices))[0, 0])


def domain(reward, cpfs="x' = x | a; y' = y; z' = z;", more=""):
    return problem_from(
        f"""domain d {{
    pvariables {{
        x : {{ state-fluent, bool, default = false }};
        y : {{ state-fluent, bool, default = false }};
        z : {{ state-fluent, bool, default = false }};
        a : {{ action-fluent, bool, default = false }};
        b : {{ action-fluent, bool, default = false }};
    }};
    cpfs {{ {cpfs} }};
    reward = {reward};
    {more}
}}
non-fluents n {{ domain = d; }}
instance inst {{
    domain = d; non-fluents = n; max-nondef-actions = pos-inf; horizon = 5; discount = 1.0;
}}"""
    )


# --- circuits ------------------------------------------------------------------------------


def test_sums_and_minima_are_simplified():
    circuit = Circuit()
    one, other = (circuit.literal(Literal(number, 1)) for number in range(2))
    assert circuit.total([one, circuit.free, one]) == one
    assert circuit.total([one, circuit.impossible]) == circuit.impossible
    assert circuit.total([]) == circuit.free
    assert circuit.least([one, circuit.impossible]) == one
    assert circuit.least([one, circuit.free]) == circuit.free
    assert circuit.least([]) == circuit.impossible
    both = circuit.total([one, other])
    assert circuit.total([other, one]) == both
    assert circuit.arguments[circuit.total([both, circuit.constant(2.0)])][:2] == (one, other)
    # two chances are not one
    half = circuit.constant(0.5)
    assert circuit.total([circuit.total([one, half]), circuit.total([other, half])]) == (
        circuit.total([one, other, circuit.constant(1.0)])
    )
    assert circuit.played(circuit.impossible, ((0, 0),)) == circuit.impossible


# --- costs ---------------------------------------------------------------------------------


def test_a_chain_costs_its_steps_and_its_chances(parcel):
    _, distances = parcel
    chance = -math.log(0.8)
    # a pick and two steps
    assert cost(distances, START) == pytest.approx(3.0 * STEP + chance, rel=1e-5)
    assert cost(distances, THERE) == 0.0
    assert cost(distances, LATE) >= FAR
    assert distances.worths.tolist() == [10.0]
    assert distances.lasts.tolist() == [False]


def test_an_action_that_only_what_is_drawn_reads_is_played():
    problem = problem_from(
        """domain d {
    pvariables {
        luck : { interm-fluent, bool };
        x : { state-fluent, bool, default = false };
        a : { action-fluent, bool, default = false };
    };
    cpfs { luck = if (a) then Bernoulli(0.5) else false; x' = x | luck; };
    reward = x;
}
non-fluents n { domain = d; }
instance inst {
    domain = d; non-fluents = n; max-nondef-actions = pos-inf; horizon = 5; discount = 1.0;
}"""
    )
    model = open_model(problem, LIMITS)
    distances = Distances(relaxed(model, LIMITS))
    state = np.array([0])
    costs = distances(state[:, np.newaxis], Prices())[:, 0]
    assert distances.to_goals(costs[:, np.newaxis])[0, 0] == pytest.approx(
        STEP + math.log(2.0), rel=1e-5
    )
    assert list(distances.ways(costs, state).helpful(0, all_ways=True)) == [((0, 0),)]


def test_equal_chances_count_each():
    problem = problem_from(
        """domain d {
    pvariables {
        c : { interm-fluent, bool };
        e : { interm-fluent, bool };
        x : { state-fluent, bool, default = false };
        a : { action-fluent, bool, default = false };
    };
    cpfs { c = Bernoulli(0.5); e = Bernoulli(0.5); x' = x | (a ^ c ^ e); };
    reward = x;
}
non-fluents n { domain = d; }
instance inst {
    domain = d; non-fluents = n; max-nondef-actions = pos-inf; horizon = 5; discount = 1.0;
}"""
    )
    distances = Distances(relaxed(open_model(problem, LIMITS), LIMITS))
    assert cost(distances, (0,)) == pytest.approx(STEP + math.log(4.0), rel=1e-5)


def test_what_needs_more_steps_is_out_of_reach():
    model = open_model(domain("z", "x' = x | a; y' = y | x; z' = z | y;"), LIMITS)
    found = relaxed(model, LIMITS)
    assert cost(Distances(found, 2), (0, 0, 0)) >= FAR
    assert cost(Distances(found, 3), (0, 0, 0)) == pytest.approx(3 * STEP, rel=1e-5)


def test_what_can_be_tried_again_costs_its_tries(parcel):
    _, distances = parcel
    prices = Prices(0.5, tries=True)
    step = math.log(2.0)
    assert cost(distances, START, prices) == pytest.approx(step * (3.0 + 0.25), rel=1e-5)


def test_helpful_actions_are_legal_now_and_on_the_way(parcel):
    model, distances = parcel
    names = [name for name, _ in model.actions]

    def helpful(state):
        costs = distances(np.array(state)[:, np.newaxis], Prices())[:, 0]
        found = distances.ways(costs, np.array(state)).helpful(0, all_ways=True)
        return {names[number] for assignment in found for number, _ in assignment}

    assert helpful(START) == {"go", "pick"}
    assert helpful((0, 1, 0, 1)) == {"go"}
    assert helpful(THERE) == {"hand-over"}
    assert helpful(LATE) == set()


def test_two_actions_that_must_go_together_are_found_together():
    model = open_model(lift(), LIMITS)
    distances = Distances(relaxed(model, LIMITS))
    state = np.array([0])
    costs = distances(state[:, np.newaxis], Prices())[:, 0]
    found = distances.ways(costs, state).helpful(0, all_ways=True)
    assert list(found) == [((0, 0), (1, 0))]
    assert distances.lasts.tolist() == [True]


def test_an_action_is_not_both_played_and_not_played():
    # a makes x by half a chance with b, and never without it; b is not legal where y never holds
    cpfs = "x' = x | (a ^ Bernoulli(if (b) then 0.5 else 0.0)); y' = y; z' = z;"
    legal = "action-preconditions { b => y; };"
    found = Distances(relaxed(open_model(domain("x", cpfs, legal), LIMITS), LIMITS))
    assert cost(found, (0, 0, 0)) >= FAR
    assert cost(found, (0, 1, 0)) < FAR
    # if nothing forbids b, both are played
    found = Distances(relaxed(open_model(domain("x", cpfs), LIMITS), LIMITS))
    assert cost(found, (0, 0, 0)) == pytest.approx(STEP + math.log(2.0), rel=1e-5)


@pytest.mark.parametrize(
    ("expression", "state", "steps"),
    [
        ("~x ^ y", (1, 0, 0), 2),  # each has an action of its own
        ("x <=> y", (1, 0, 0), 1),
        ("~(x <=> y)", (1, 1, 0), 1),
        ("if (x) then y else z", (0, 0, 0), 2),
        ("if (x) then y else z", (0, 1, 0), 1),
        ("x => y", (1, 0, 0), 1),
        ("(x + y) > 0", (0, 0, 0), 1),
        ("(x + y) >= 1", (1, 0, 0), 0),
        ("(0.05 * x + 0.1 * y) > 0.04", (0, 0, 0), 1),  # weights are no chances
        ("(0.05 * x) ~= 0", (0, 0, 0), 1),
        ("(1 - x) > 0", (1, 0, 0), 1),
        ("((x - y) ~= 0) ^ y", (0, 0, 0), 1),  # below 0 is not 0 either
        ("((0 - (-1 * y)) > 0) ^ y", (0, 0, 0), 1),
    ],
)
def test_conditions_of_all_forms(expression, state, steps):
    cpfs = "x' = if (a) then ~x else x; y' = y | b; z' = z;"
    reward = f"if ({expression}) then 1.0 else 0.0"
    found = relaxed(open_model(domain(reward, cpfs), LIMITS), LIMITS)
    distances = Distances(found)
    costs = distances.to_goals(distances(np.array(state)[:, np.newaxis], Prices()))[:, 0]
    assert costs.min() == pytest.approx(steps * STEP, rel=1e-5)


# --- the reward ----------------------------------------------------------------------------


def test_a_reward_is_taken_apart():
    model = open_model(domain("3 * x - 2 * y * z + (if (z) then 4 else 1) * (1 + x)"), LIMITS)
    graph = model.graph
    found = {
        (frozenset(graph.values[node][0] for node in each.nodes), each.wanted, each.is_any): each
        for each in conditions(graph, model.rules.reward, LIMITS)
    }
    assert found[frozenset("x"), (True,), False].worth >= 3.0
    # what is taken while both hold is paid while one does not
    assert found[frozenset("yz"), (False, False), True].worth == 2.0
    # a product of two numbers is not understood
    assert len(found) == 2


@pytest.mark.parametrize(
    "reward",
    ["((x * 2) * (1 + y)) * (1 + z)", "(1 + y) * ((1 + z) * (2 * x))", "2 * x * (1 + y) * (1 + z)"],
)
def test_a_product_is_the_same_however_it_is_nested(reward):
    model = open_model(domain(reward), LIMITS)
    (found,) = conditions(model.graph, model.rules.reward, LIMITS)
    assert [model.graph.values[node][0] for node in found.nodes] == ["x"]
    assert (found.worth, found.wanted, found.is_any) == (8.0, (True,), False)


def test_numbers_below_0_may_have_a_product_above_0():
    model = open_model(domain("x * ((-2 - y) * (-2 - z)) * (1 + y)"), LIMITS)
    (found,) = conditions(model.graph, model.rules.reward, LIMITS)
    assert found.worth == 18.0


def test_a_product_of_many_factors_is_left_as_it_is():
    model = open_model(domain("x"), LIMITS)
    graph, node = model.graph, model.graph.make("+", model.graph.one, model.rules.reward)
    for _ in range(40):
        node = graph.make("*", node, node)
    reward = graph.make("*", model.rules.reward, node)
    # 2 to the 40 products would never end
    assert len(conditions(graph, reward, LIMITS)) <= 1


def test_a_reward_that_no_play_changes_is_no_goal():
    with pytest.raises(NotEnumerableError, match="no reward"):
        relaxed(open_model(domain("1.0"), LIMITS), LIMITS)


def test_a_reward_of_too_many_conditions_is_refused(monkeypatch):
    model = open_model(domain("3 * x - 2 * y"), LIMITS)
    monkeypatch.setattr("mdpo_rddl.problem.delete_relaxation.conditions._MOST", 1)
    with pytest.raises(NotEnumerableError, match="more than 1 conditions"):
        conditions(model.graph, model.rules.reward, LIMITS)


def test_it_takes_no_longer_than_it_may():
    model = open_model(courier(), LIMITS)
    with pytest.raises(NotEnumerableError, match="more than 1 s"):
        relaxed(model, EnumerationLimits(1.0, clock=Ticking(0.5)))


@pytest.mark.parametrize("decay", [0.0, 1.0, -0.5, math.nan])
def test_a_decay_is_between_0_and_1(decay):
    with pytest.raises(ValueError, match="decay"):
        Prices(decay)


def test_what_chance_may_cause_as_well_must_neither_be_caused_nor_come_by_chance():
    cpfs = "x' = x | a; y' = (y ^ ~x) | Bernoulli(0.2); z' = z;"
    found = Distances(relaxed(open_model(domain("-1.0 * y", cpfs), LIMITS), LIMITS))
    luck = -math.log(0.8)
    assert cost(found, (0, 0, 0)) == 0.0
    assert cost(found, (1, 1, 0)) == pytest.approx(STEP + luck, rel=1e-5)
    assert cost(found, (0, 1, 0)) == pytest.approx(2 * STEP + luck, rel=1e-5)


@pytest.mark.parametrize(
    "chance", ["1.0 + -0.5 * x", "1.0 + -0.3 * x + -0.2 * z", "1.0 * y + -0.6 * x"]
)
def test_what_fails_by_a_summand_below_0_is_in_reach(chance):
    cpfs = f"x' = x | a; y' = Bernoulli({chance}); z' = z | b;"
    found = Distances(relaxed(open_model(domain("-1.0 * y", cpfs), LIMITS), LIMITS))
    assert cost(found, (1, 1, 0)) < FAR


def test_the_complement_of_a_chance_is_one():
    cpfs = "x' = x | a; y' = Bernoulli(0.2) | ~Bernoulli(0.5 * (y ^ ~x)); z' = z;"
    found = Distances(relaxed(open_model(domain("-1.0 * y", cpfs), LIMITS), LIMITS))
    # the law is a sum over both draws, of which each part must fail
    assert STEP - math.log(0.5) < cost(found, (0, 1, 0)) < FAR


@pytest.mark.parametrize(
    ("law", "chance", "is_changed"),
    [
        ("n + 1", "0.5 * a", False),
        ("n + a", "0.5", True),
        ("n + step", "0.5", False),
        # by what is drawn as well
        ("n + step", "0.5 * a", True),
    ],
)
def test_whether_actions_change_integers(law, chance, is_changed):
    text = f"""domain d {{
    pvariables {{
        n : {{ state-fluent, int, default = 0 }};
        x : {{ state-fluent, bool, default = false }};
        step : {{ interm-fluent, bool }};
        a : {{ action-fluent, bool, default = false }};
    }};
    cpfs {{ step = Bernoulli({chance}); n' = {law}; x' = x | step; }};
    reward = x;
}}
non-fluents m {{ domain = d; }}
instance inst {{
    domain = d; non-fluents = m; max-nondef-actions = pos-inf; horizon = 5; discount = 1.0;
}}"""
    assert changes_integers(open_model(problem_from(text), LIMITS)) is is_changed
