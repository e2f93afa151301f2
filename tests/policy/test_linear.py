"""Numbers of many replicas at the nearest point that linear preconditions leave them, in 64 bit."""

import functools
from pathlib import Path

import numpy as np
import pytest
from helpers.choices import AHEAD, SHARED, SQUARES, pushes, takes
from helpers.orders import BUDGETS, STAFF, orders
from helpers.toys import problem_from

from mdpo_rddl.policy.legal import LegalActions
from mdpo_rddl.problem.legality import Referee
from mdpo_rddl.problem.load import load_problem, make_environment
from mdpo_rddl.simulator.simulator import Simulator

ALL = "(sum_{?s : shop, ?i : item} [buy(?s, ?i)])"
OWN = "(sum_{?i : item} [buy(?s, ?i)])"


@functools.cache
def layer(rules):
    simulator = Simulator(orders(rules))
    return simulator, LegalActions(simulator, [])


def played(rules, buy=((0, 0), (0, 0)), hire=(0, 0), close=False, **state):
    """What becomes of a proposal, and whether the simulator allows it, to the last bit."""
    simulator, legal = layer(rules)
    proposal = {
        "buy": np.array(buy, float)[..., np.newaxis],
        "hire": np.array(hire, np.int32)[..., np.newaxis],
        "close": np.array([close]),
    }
    known = {
        name: np.array(value, simulator.values[name].dtype)[..., np.newaxis]
        for name, value in state.items()
    }
    actions = legal(proposal, lambda: {"close": proposal["close"].astype(float)}, known)
    is_legal = bool(simulator.legal({**simulator.initial(1), **known}, actions)[0])
    return {name: value[..., 0] for name, value in actions.items()}, is_legal


@pytest.mark.parametrize(
    ("rules", "buy", "expected"),
    [
        # back by multiples of the prices, 1 and 2; what keeps its budget stays
        (BUDGETS, ((4, 4), (2, 1)), ((2.8, 1.6), (2, 1))),
        # a small proposal gives way to a large one
        (BUDGETS, ((9, 0.5), (0, 5)), ((6, 0), (0, 3))),
        (f"{ALL} == 1.0;", ((0, 0), (0, 0)), ((0.25, 0.25), (0.25, 0.25))),
        (f"{ALL} == 1.0;", ((3, 2.5), (0, 0)), ((0.75, 0.25), (0, 0))),
        (f"{ALL} == 1.0;", ((1, 0), (0, 0)), ((1, 0), (0, 0))),
        (f"{ALL} <= 1.0001; {ALL} >= 0.9999;", ((1, 1), (0, 0)), ((0.50005, 0.50005), (0, 0))),
        (f"abs[{ALL} - 1.0] <= 0.0001;", ((1, 1), (0, 0)), ((0.50005, 0.50005), (0, 0))),
        # cash is 6 for each shop
        (f"forall_{{?s : shop}} [{OWN} == cash(?s)];", ((4, 4), (0, 2)), ((3, 3), (2, 4))),
        (f"forall_{{?s : shop}} [{OWN} >= cash(?s)];", ((1, 2), (9, 0)), ((2.5, 3.5), (9, 0))),
        # under guards
        (f"is-open => ({ALL} == 1.0);", ((2, 0), (0, 0)), ((1, 0), (0, 0))),
        (f"~is-open | ({ALL} == 1.0);", ((2, 0), (0, 0)), ((1, 0), (0, 0))),
        (
            f"if (is-open) then ({ALL} == 1.0) else ({ALL} == 0.0);",
            ((2, 0), (0, 0)),
            ((1, 0), (0, 0)),
        ),
        (f"~is-open => ({ALL} == 1.0);", ((2, 0), (0, 0)), ((2, 0), (0, 0))),
        # with numbers in common
        (
            f"forall_{{?s : shop}} [{OWN} == cash(?s)];"
            "forall_{?i : item} [(sum_{?s : shop} [buy(?s, ?i)]) == 6];",
            ((4, 4), (0, 4)),
            ((4, 2), (2, 4)),
        ),
        # each within its own bound, then within the sum
        (
            "forall_{?s : shop, ?i : item} [buy(?s, ?i) <= cash(?s) / 2];" + f"{ALL} <= 5.0;",
            ((9, 0), (4, 0)),
            ((2.5, 0), (2.5, 0)),
        ),
    ],
)
def test_reals_go_to_the_nearest_point(rules, buy, expected):
    actions, is_legal = played(rules, buy)
    np.testing.assert_allclose(actions["buy"], expected, atol=1e-6)
    assert is_legal


def test_coefficients_may_be_fluents():
    for factor in ("cash(?s)", "count(?s)", "WEIGHT(kind(?s))"):
        rule = f"forall_{{?s : shop}} [{factor} * {OWN} <= 12.0];"
        state = {"cash": [2.0, 3.0], "count": [2, 3], "kind": [0, 1]}
        actions, is_legal = played(rule, [[4.0, 2.0], [4.0, 2.0]], **state)
        np.testing.assert_allclose(actions["buy"], [[4.0, 2.0], [3.0, 1.0]], atol=1e-6)
        assert is_legal


@pytest.mark.parametrize(
    ("rule", "hire", "total"),
    [
        (STAFF, (8, 8), 3),
        (STAFF, (5, 1), 3),
        (STAFF, (1, 1), 2),
        (STAFF.replace("<= 3", "< 3"), (8, 8), 2),
        ("3.0 >= (sum_{?s : shop} [hire(?s)]);", (4, 4), 3),
        ("2 * (sum_{?s : shop} [hire(?s)]) <= 7;", (4, 4), 3),
        ("(sum_{?s : shop} [hire(?s)]) == 3;", (8, 6), 3),
        ("(sum_{?s : shop} [hire(?s)]) >= 9;", (3, 1), 9),
        ("is-open => (sum_{?s : shop} [hire(?s)]) <= 3;", (4, 1), 3),
        ("~is-open => (sum_{?s : shop} [hire(?s)]) <= 3;", (4, 1), 5),
    ],
)
def test_integers_share_all_there_is(rule, hire, total):
    actions, is_legal = played(rule, hire=hire)
    assert actions["hire"].dtype.kind == "i"
    assert actions["hire"].sum() == total
    assert is_legal
    # no less of what was more
    assert (actions["hire"][0] - actions["hire"][1]) * (hire[0] - hire[1]) >= 0


def test_numbers_give_way_to_bools():
    buy = [[4.0, 4.0], [0.0, 0.0]]
    rule = f"{ALL} + 4 * close <= 8;"
    assert played(rule, buy)[0]["buy"].tolist() == buy
    actions, is_legal = played(rule, buy, close=True)
    np.testing.assert_allclose(actions["buy"], np.array(buy) / 2.0, atol=1e-6)
    assert actions["close"]
    assert is_legal


@pytest.mark.parametrize(
    ("rules", "state"),
    [
        # no point of the box keeps it
        (BUDGETS, {"cash": (-1.0, 6.0)}),
        # what is no number says nothing
        (f"forall_{{?s : shop}} [{OWN} <= sqrt[-1.0 - cash(?s)]];", {"cash": (0.0, 0.0)}),
    ],
)
def test_where_nothing_keeps_it_the_proposal_stands(rules, state):
    buy = [[4.0, 4.0], [2.0, 1.0]]
    actions, is_legal = played(rules, buy, **state)
    assert actions["buy"].tolist() == buy
    assert not is_legal


def test_many_replicas_are_as_each_alone():
    simulator, legal = layer(BUDGETS + STAFF)
    draws = np.random.default_rng(0)
    proposal = {
        "buy": draws.uniform(0.0, 9.0, (2, 2, 50)),
        "hire": draws.integers(0, 9, (2, 50)).astype(np.int32),
        "close": draws.random(50) < 0.5,
    }
    state = {"cash": draws.uniform(0.0, 9.0, (2, 50))}

    def made(which):
        some = {name: value[..., which].copy() for name, value in proposal.items()}
        known = {name: value[..., which] for name, value in state.items()}
        return legal(some, lambda: {"close": some["close"].astype(float)}, known)

    whole = made(slice(None))
    assert simulator.legal({**simulator.initial(50), **state}, whole).all()
    for number in range(50):
        for name, value in made(slice(number, number + 1)).items():
            np.testing.assert_allclose(value[..., 0], whole[name][..., number], atol=1e-9)


@pytest.mark.parametrize(
    ("rules", "proposed", "expected"),
    [
        (AHEAD, [1.0, 0.9], [0.2, 0.5]),
        (AHEAD, [0.3, -0.7], [0.2, -0.7]),
        (SHARED, [0.5, 0.4], [0.35, 0.25]),
        # of one that is not linear the larger change takes what it needs, the other what is left
        (SQUARES, [0.5, 0.4], [0.5, 0.1]),
    ],
)
def test_a_real_goes_as_far_as_is_legal(rules, proposed, expected):
    simulator = Simulator(pushes(rules))
    state = {"x": np.array([[0.0], [0.3]])}
    proposal = {"push": np.array(proposed)[:, np.newaxis], "light": np.array([False])}
    actions = LegalActions(simulator, [])(proposal, lambda: {"light": np.zeros(1)}, state)
    np.testing.assert_allclose(actions["push"][:, 0], expected, atol=1.0 / 128.0)
    assert simulator.legal(state, actions).all()


def test_each_whole_number_stays_in_its_own_box():
    simulator = Simulator(takes("(sum_{?i : item} [take(?i)]) == 4;"))
    proposal = {"take": np.array([[5, 0, 1], [0, 0, 9]], np.int32)}
    actions = LegalActions(simulator, [])(proposal, dict, {})
    assert simulator.legal(simulator.initial(3), actions).all()
    # the first one has no more than two
    assert actions["take"][:, 0].tolist() == [2, 2]


def test_weights_whose_sum_is_one_are_legal_in_the_environment():
    text = """domain mix {
        types { part : object; };
        pvariables {
            w(part) : { action-fluent, real, default = 0.0 };
            x : { state-fluent, real, default = 0.0 };
        };
        cpfs { x' = x + (sum_{?p : part} [pow[w(?p), 2]]); };
        reward = -x;
        action-preconditions {
            forall_{?p : part} [w(?p) >= 0.0]; (sum_{?p : part} [w(?p)]) == 1.0;
        };
    }
    non-fluents nf { domain = mix; objects { part : {a, b, c, d, e, f, g}; }; }
    instance one {
        domain = mix; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 4; discount = 1.0;
    }"""
    problem = problem_from("\n".join(line.strip() for line in text.splitlines()))
    simulator, count = Simulator(problem), 200
    proposal = {"w": np.random.default_rng(0).uniform(0.0, 2.0, (7, count))}
    actions = LegalActions(simulator, [])(dict(proposal), dict, {})
    assert simulator.legal(simulator.initial(count), actions).all()
    env = make_environment(problem)
    env.reset(seed=0)
    referee = Referee(env)
    for number in range(20):
        verdict = referee.rule({"w": actions["w"][:, number]})
        assert not verdict.illegal
        np.testing.assert_array_equal(verdict.actions["w"], actions["w"][:, number])
    # the Euclidean projection: all that is left has gone down by as much
    gone = np.where(actions["w"] > 1e-9, proposal["w"] - actions["w"], np.nan)
    np.testing.assert_allclose(np.nanmax(gone, axis=0), np.nanmin(gone, axis=0), atol=1e-8)


def test_units_that_are_switched_serve_a_load():
    folder = Path(__file__).parents[2] / "examples" / "units"
    simulator = Simulator(load_problem(str(folder / "units.rddl"), str(folder / "four.rddl")))
    draws, count = np.random.default_rng(2), 20
    likely, power = draws.random((4, count)), draws.uniform(0.0, 9.0, (4, count))
    proposal = {"on": likely > 0.5, "power": power}
    actions = LegalActions(simulator, [])(dict(proposal), lambda: {"on": likely}, {})
    assert simulator.legal(simulator.initial(count), actions).all()
    np.testing.assert_array_equal(actions["on"], likely > 0.5)
    # each within its bounds, and no further back than the load, of 8, asks for
    most = np.array([5.0, 5.0, 5.0, 8.0])[:, np.newaxis]
    within = np.where(likely > 0.5, np.clip(power, 1.0, most), 0.0).sum(axis=0)
    np.testing.assert_allclose(actions["power"].sum(axis=0), np.minimum(8.0, within), atol=1e-6)
