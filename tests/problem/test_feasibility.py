"""Real actions that keep equalities to the last bit, as the environment evaluates them."""

import functools

import numpy as np
import pytest
from helpers.toys import problem_from

from mdpo_rddl.problem.legality import Referee
from mdpo_rddl.problem.load import make_environment

DOMAIN = """
domain mixing {
    types { line : object; place : object; };
    pvariables {
        CAP(line) : { non-fluent, real, default = 0.7 };
        NEED(place) : { non-fluent, real, default = 1.0 };
        stock : { state-fluent, real, default = 0.1 };
        is-on : { state-fluent, bool, default = true };
        w(line, place) : { action-fluent, real, default = 0.0 };
        a : { action-fluent, real, default = 0.0 };
        b : { action-fluent, real, default = 0.0 };
        count : { action-fluent, int, default = 0 };
    };
    cpfs { stock' = stock + a; is-on' = ~is-on; };
    reward = stock;
    action-preconditions { RULES };
}
non-fluents nf {
    domain = mixing; objects { line : {x, y}; place : {p, q, r}; };
    non-fluents { CAP(y) = 2.3; };
}
instance one {
    domain = mixing; non-fluents = nf; max-nondef-actions = pos-inf; horizon = 3; discount = 1.0;
}
"""
BOX = "forall_{?i : line, ?j : place} [w(?i, ?j) >= 0.0];"
SUM = "(sum_{?i : line, ?j : place} [w(?i, ?j)])"
ROWS = "forall_{?i : line} [(sum_{?j : place} [w(?i, ?j)]) == CAP(?i)];"
COLUMNS = "forall_{?j : place} [(sum_{?i : line} [w(?i, ?j)]) == NEED(?j)];"


@functools.cache
def environment_of(rules):
    env = make_environment(problem_from(DOMAIN.replace("RULES", rules)), True)
    env.reset(seed=0)
    return env


def ruled(rules, **proposal):
    env = environment_of(rules)
    verdict = Referee(env).rule({name: np.asarray(value) for name, value in proposal.items()})
    is_legal = env.sampler.check_action_preconditions(verdict.actions, silent=True)
    assert is_legal or (verdict.illegal and not verdict.fallback)
    return verdict


def test_the_rest_is_what_is_left_of_the_sum():
    # in 32 bit the three add up to 1 + 3e-8
    w = np.zeros((2, 3), np.float32)
    w[0] = 0.1, 0.2, 0.7
    verdict = ruled(BOX + SUM + " == 1.0;", w=w)
    assert (verdict.illegal, verdict.fallback) == (False, False)
    assert verdict.actions["w"] == pytest.approx(w, abs=1e-7)
    assert np.sum(verdict.actions["w"]) == 1.0


@pytest.mark.parametrize(
    "rules",
    [
        BOX + SUM + " == 1.0;",
        BOX + "1.0 == " + SUM + ";",
        BOX + SUM + " - 1.0 == 0.0;",
        BOX + SUM + " == stock;",
        BOX + f"{SUM} <= 1.000000001; {SUM} >= 0.999999999;",
        BOX + f"abs[{SUM} - 1.0] <= 0.000000001;",
        BOX + f"{SUM} < 1.00000001; {SUM} > 0.99999999;",
        "a == 2 * b;",
        "a == 0.3 * b;",
        "a - 0.1 == (b - stock) / 3.0;",
        "a + count == 2.5 * b;",
        BOX + ROWS,
        # what both add up to is the same
        BOX + ROWS + COLUMNS,
        BOX + ROWS + "forall_{?j : place} [(sum_{?i : line} [w(?i, ?j)]) <= 1.01];",
        BOX + f"is-on => ({SUM} == 1.3);",
        BOX + f"~is-on | ({SUM} == 1.3);",
        BOX + f"if (is-on) then ({SUM} == 1.3) else ({SUM} == 0.0);",
        BOX + "forall_{?i : line} [is-on => (sum_{?j : place} [w(?i, ?j)]) == CAP(?i)];",
    ],
)
def test_what_32_bits_lose_of_a_legal_action_is_given_back(rules):
    random = np.random.default_rng(0)
    for _ in range(30):
        shares = {
            "w": random.uniform(0.0, 2.0, (2, 3)),
            "a": random.normal(),
            "b": random.normal(),
            "count": int(random.integers(5)),
        }
        legal = ruled(rules, **shares).actions
        rounded = {name: np.asarray(value, np.float32) for name, value in legal.items()}
        verdict = ruled(rules, **{**rounded, "count": shares["count"]})
        assert (verdict.illegal, verdict.fallback) == (False, False)
        for name in ("w", "a", "b"):
            assert verdict.actions[name] == pytest.approx(legal[name], abs=1e-6)


@pytest.mark.parametrize(
    ("rules", "given", "expected"),
    [
        # each goes by the same
        (BOX + SUM + " == 3.0;", [[0, 0, 0], [0, 0, 0]], [[0.5, 0.5, 0.5], [0.5, 0.5, 0.5]]),
        (BOX + SUM + " == 1.0;", [[3, 2, 0], [0, 0, 0]], [[1, 0, 0], [0, 0, 0]]),
        (BOX + ROWS, [[1, 0, 0], [2, 0, 0]], [[0.7, 0, 0], [2.1, 0.1, 0.1]]),
        (BOX + SUM + " <= 1.0;", [[2, 1, 0], [0, 0, 0]], [[1, 0, 0], [0, 0, 0]]),
        # rows and columns at once
        (BOX + ROWS + COLUMNS, [[0, 0, 0], [0, 0, 0]], [[0.7 / 3] * 3, [2.3 / 3] * 3]),
        # the columns ask for 1, 1/2 and 1/2 of x, which may do with 1.3 less
        (
            BOX + ROWS.replace("==", "<=") + COLUMNS,
            [[1, 0, 0], [0, 0, 0]],
            [[1 - 1.3 / 3] + [0.5 - 1.3 / 3] * 2, [1.3 / 3] + [0.5 + 1.3 / 3] * 2],
        ),
    ],
)
def test_the_nearest_point_is_the_first_fallback(rules, given, expected):
    verdict = ruled(rules, w=np.array(given, float))
    assert (verdict.illegal, verdict.fallback) == (True, True)
    assert verdict.actions["w"] == pytest.approx(np.array(expected, float), abs=1e-9)


def test_a_guard_that_does_not_hold_asks_nothing():
    w = np.array([[0.2, 0.0, 0.0], [0.0, 0.0, 0.0]])
    verdict = ruled(BOX + f"~is-on => ({SUM} == 1.3);", w=w)
    assert not verdict.illegal
    assert np.array_equal(verdict.actions["w"], w)


def test_what_has_no_solution_stands():
    verdict = ruled(BOX + SUM + " == -1.0;", w=np.zeros((2, 3)))
    assert (verdict.illegal, verdict.fallback) == (True, False)
    assert not np.any(verdict.actions["w"])
