"""Boxes of integer actions that follow from what the state can be, worked out by hand."""

import itertools

import numpy as np
import pytest
from helpers.toys import problem_from

from mdpo_rddl.problem.intervals import with_reachable_bounds
from mdpo_rddl.problem.legality import action_box
from mdpo_rddl.problem.load import make_environment

DOMAIN = """
domain tanks {
    types { tank : object; mode : { @slow, @fast }; };
    pvariables {
        CAP(tank) : { non-fluent, int, default = 6 };
        FLOW : { non-fluent, int, default = 2 };
        stock(tank) : { state-fluent, int, default = 3 };
        total : { state-fluent, int, default = 4 };
        is-on : { state-fluent, bool, default = false };
        speed : { state-fluent, mode, default = @slow };
        near(tank) : { interm-fluent, int };
        buy(tank) : { action-fluent, int, default = 0 };
        sell(tank) : { action-fluent, int, default = 0 };
        k : { action-fluent, int, default = 0 };
    };
    cpfs {
        near(?t) = stock(?t) + buy(?t) - sell(?t);
        stock'(?t) = STOCK;
        total' = TOTAL;
        is-on' = Bernoulli(0.5);
        speed' = if (is-on) then @fast else @slow;
    };
    reward = total + k;
    action-preconditions {
        forall_{?t : tank} [buy(?t) >= 0 ^ sell(?t) >= 0];
        k >= 0;
        RULES
    };
}
non-fluents nf {
    domain = tanks; objects { tank : {x, y}; }; non-fluents { CAP(y) = 4; };
}
instance one {
    domain = tanks; non-fluents = nf; max-nondef-actions = pos-inf; horizon = STEPS; discount = 1.0;
}
"""
SELL = "forall_{?t : tank} [sell(?t) <= stock(?t)];"


def box_of(rules, stock="near(?t)", total="total", horizon=1000):
    text = DOMAIN.replace("RULES", rules).replace("STOCK", stock).replace("TOTAL", total)
    return action_box(make_environment(problem_from(text.replace("STEPS", str(horizon)))))


def upper(name, *args, **kwargs):
    return np.asarray(box_of(*args, **kwargs)[name][1]).tolist()


@pytest.mark.parametrize(
    ("stock", "expected"),
    [
        ("min[CAP(?t), near(?t)]", [6, 4]),
        ("if (near(?t) > CAP(?t)) then CAP(?t) else near(?t)", [6, 4]),
        ("if (near(?t) <= CAP(?t)) then near(?t) else CAP(?t)", [6, 4]),
        ("max[0, min[CAP(?t), stock(?t) + Poisson(2.0)]]", [6, 4]),
        ("if (stock(?t) < CAP(?t)) then stock(?t) + 1 else stock(?t)", [6, 4]),
        ("mod[near(?t), 5]", [4, 4]),
        ("KronDelta(stock(?t))", [3, 3]),
        ("Binomial(8, 0.5)", [8, 8]),
        ("stock(?t) - sell(?t)", [3, 3]),
        ("3 * is-on", [3, 3]),
        # nothing holds them
        ("near(?t)", [np.inf, np.inf]),
        ("stock(?t) + Poisson(2.0)", [np.inf, np.inf]),
    ],
)
def test_what_is_sold_is_bounded_by_what_the_stock_can_be(stock, expected):
    assert upper("sell", SELL, stock) == expected


def test_what_preconditions_keep_in_a_tank_stays_there():
    # stock + buy - sell lies between 0 and the capacity, though its parts' intervals say more
    rules = SELL + "forall_{?t : tank} [buy(?t) <= CAP(?t) - stock(?t)];"
    box = box_of(rules)
    assert np.asarray(box["sell"]).tolist() == [[0, 0], [6, 4]]
    assert np.asarray(box["buy"]).tolist() == [[0, 0], [6, 4]]


def test_one_bound_may_follow_from_another_action():
    rules = "forall_{?t : tank} [sell(?t) + buy(?t) <= stock(?t)];"
    assert upper("buy", rules, "stock(?t) - sell(?t)") == [3, 3]


@pytest.mark.parametrize(
    ("rules", "total", "expected"),
    [
        ("if (is-on) then k <= 10 else k <= 0;", "total", 10),
        ("(is-on => k <= 10) ^ (~is-on => k <= 3);", "total", 10),
        ("(is-on ^ k <= 10) | (~is-on ^ k == 2);", "total", 10),
        ("k <= (if (is-on) then 7 else 3);", "total", 7),
        ("if (total > 4) then k <= 50 else k <= 2;", "total", 2),
        ("if (total > 4) then k <= 50 else k <= 2;", "total + is-on", 50),
        ("k <= 5 + 5 * is-on;", "total", 10),
        ("forall_{?t : tank} [is-on => k <= CAP(?t)]; ~is-on => k <= 2;", "total", 4),
        ("speed == @slow => k <= 2; speed == @fast => k <= 9;", "total", 9),
        ("k <= switch (speed) { case @slow : 2, case @fast : 8 };", "total", 8),
        ("total - k >= -1;", "total", 5),
        ("k * FLOW <= total;", "total", 2),
        ("k < total;", "max[total - 1, 0]", 3),
        ("k <= min[FLOW + 1, total];", "total", 3),
        ("max[k, 2 * k - 5] <= total;", "total", 4),
        ("abs[k - total] <= 2;", "total", 6),
        ("k + (sum_{?t : tank} [sell(?t)]) <= total;", "total", 4),
        ("k <= (max_{?t : tank} [stock(?t)]);", "total", 3),
        # nothing bounds it in the other case
        ("is-on => k <= 10;", "total", np.inf),
        ("k >= total;", "total", np.inf),
    ],
)
def test_the_largest_number_that_is_legal_in_some_state(rules, total, expected):
    assert upper("k", rules, "stock(?t)", total) == expected


def test_short_horizons_bound_what_grows():
    # 4, 5, 6 at the three decisions
    assert upper("k", "k <= total;", "stock(?t)", "total + 1", horizon=3) == 6
    assert upper("k", "k <= total;", "stock(?t)", "total + 1", horizon=1000) == np.inf


def test_long_chains_come_to_their_end():
    assert upper("k", "k <= total;", "stock(?t)", "min[total + 1, 300]", horizon=1000) == 300


def test_invariants_hold_where_there_is_a_decision():
    text = DOMAIN.replace(
        "action-preconditions", "state-invariants { total <= 9; };\naction-preconditions"
    )
    text = text.replace("RULES", "k <= total;").replace("STOCK", "stock(?t)")
    text = text.replace("TOTAL", "total + 2").replace("STEPS", "1000")
    assert action_box(make_environment(problem_from(text)))["k"] == (0, 9)


def test_every_legal_action_of_every_reachable_state_is_in_the_box():
    rules = (
        SELL
        + """forall_{?t : tank} [buy(?t) <= FLOW];
        if (is-on) then k <= total else k <= 1;"""
    )
    text = DOMAIN.replace("RULES", rules).replace("STOCK", "min[CAP(?t), near(?t)]")
    text = text.replace("TOTAL", "max[0, min[8, total + k - 1]]").replace("STEPS", "30")
    env = make_environment(problem_from(text))
    box, random = action_box(env), np.random.default_rng(0)
    assert np.asarray(box["sell"][1]).tolist() == [6, 4]
    assert box["k"] == (0, 8)
    reached = 0
    for seed in range(10):
        env.reset(seed=seed)
        for _ in range(30):
            legal = []
            for buy, sell, k in itertools.product(range(4), range(8), range(10)):
                actions = {"buy": np.array([buy, 0]), "sell": np.array([sell, 0]), "k": k}
                if env.sampler.check_action_preconditions(actions, silent=True):
                    legal.append(actions)
                    assert sell <= box["sell"][1][0]
                    assert k <= box["k"][1]
                    reached = max(reached, k)
            env.step(legal[random.integers(len(legal))])
    assert reached == 8


def test_actions_that_read_no_state_keep_their_box():
    env = make_environment(
        problem_from(
            DOMAIN.replace("RULES", "k <= 5;")
            .replace("STOCK", "stock(?t)")
            .replace("TOTAL", "total")
            .replace("STEPS", "3")
        )
    )
    box = {"k": (0.0, 5.0)}
    assert with_reachable_bounds(env.sampler, box) == box
