"""Valid problems that are not written as others are, and proposals of another form."""

import sys
import threading

import numpy as np
import pytest
from helpers.toys import problem_from

from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import ground_model
from mdpo_rddl.problem.legality import Referee
from mdpo_rddl.problem.load import make_environment
from mdpo_rddl.problem.random_actions import RandomActions

NUMBERS = """domain d {
    pvariables {
        s : { state-fluent, real, default = 0.0 };
        b : { action-fluent, bool, default = false };
        r : { action-fluent, real, default = 0.0 };
        n : { action-fluent, int, default = 0 };
    };
    cpfs { s' = NEXT; };
    reward = s;
    action-preconditions { r >= 1; r <= 2; n > 0; n < 4; b => (s <= 1); };
}
non-fluents nf { domain = d; }
instance one { domain = d; non-fluents = nf; horizon = 3; discount = 1.0; }
"""

CHOICE = """domain d {
    types { k : { @p, @q }; };
    pvariables {
        x : { state-fluent, k, default = @p };
        n : { state-fluent, int, default = FIRST };
        b : { state-fluent, bool, default = false };
        a : { action-fluent, bool, default = false };
    };
    cpfs {
        b' = a;
        n' = if (a) then min[n + 1, 3] else n;
        x' = if (b) then DRAW else @p;
    };
    reward = (if (x == @q) then 10 else b) + (if (n > 0) then pow[2, n - 1] else 0);
}
non-fluents nf { domain = d; }
instance one { domain = d; non-fluents = nf; horizon = 3; discount = 1.0; }
"""


def refereed(found):
    env = make_environment(found, enforce_action_constraints=True)
    env.reset(seed=0)
    return env, Referee(env)


def test_where_a_default_is_outside_its_box_the_nearest_number_is_played():
    env, referee = refereed(problem_from(NUMBERS.replace("NEXT", "s + r + n")))
    ruled = referee.rule({"r": float("nan"), "n": 2, "b": False})
    assert ruled.fallback
    assert ruled.actions == {"r": 1.0, "n": 1, "b": False}
    env.step({"r": 2.0, "n": 3})
    # what its precondition forbids now
    ruled = referee.rule({"r": 1.5, "n": 2, "b": True})
    assert ruled.actions == {"r": 1.0, "n": 1, "b": False}
    env.step(ruled.actions)


@pytest.mark.parametrize(
    "proposal", [{"n": 1.5, "r": [1.0, 2.0]}, {"b": [True, False]}, {"nobody": 1}]
)
def test_a_proposal_of_another_form_is_illegal(proposal):
    env, referee = refereed(problem_from(NUMBERS.replace("NEXT", "s + r + n")))
    ruled = referee.rule({"r": 1.0, "n": 1} | proposal)
    assert ruled.fallback
    env.step(ruled.actions)


def test_a_no_op_without_a_value_is_no_mistake_where_it_is_illegal():
    found = problem_from(NUMBERS.replace("NEXT", "Exponential(r)"))
    env, _ = refereed(found)
    assert env.step({"r": 1.0, "n": 1})[1] == 0.0


def test_integers_are_drawn_from_those_in_their_box():
    found = problem_from(NUMBERS.replace("NEXT", "s + r + n"))
    random, rng = RandomActions(found), np.random.default_rng(0)
    state, _ = make_environment(found).reset(seed=0)
    draws = [random.draw(state, rng) for _ in range(100)]
    assert {int(draw["n"]) for draw in draws} == {1, 2, 3}
    assert all(1.0 <= draw["r"] <= 2.0 for draw in draws)


def choice(draw, first="0"):
    return problem_from(CHOICE.replace("DRAW", draw).replace("FIRST", first))


@pytest.mark.parametrize(
    "draw",
    [
        "Discrete(k, @p: 0.2, @q: 0.2)",
        "Discrete(k, @p: 1.5, @q: -0.5)",
        "UnnormDiscrete(k, @p: -1.0, @q: -1.0)",
        "UnnormDiscrete(k, @p: -1.0, @q: 3.0)",
    ],
)
def test_weights_that_the_environment_refuses_prove_nothing(draw):
    with pytest.raises(NotEnumerableError, match="a probability outside of"):
        find_optimum(choice(draw), 20.0)


@pytest.mark.parametrize(
    "draw", ["Discrete(k, @p: 0.8, @q: 0.2)", "UnnormDiscrete(k, @p: 4.0, @q: 1.0)"]
)
def test_a_power_with_a_negative_exponent_in_a_branch_not_taken_costs_nothing(draw):
    # a, a, a: n is 0, 1, 2, and in the third step x is drawn after b
    value = find_optimum(choice(draw), 20.0).optimum.value
    assert value == pytest.approx((0 + 0) + (1 + 1) + (0.8 * 1 + 0.2 * 10 + 2))


def test_an_initial_number_of_too_many_bits_is_not_enumerated():
    found = choice("@q", "40000")
    with pytest.raises(NotEnumerableError, match="bits"):
        ground_model(found, EnumerationLimits(20.0))


def test_threads_that_make_environments_leave_standard_output(capsys):
    found = choice("@q")
    threads = [threading.Thread(target=make_environment, args=(found,)) for _ in range(16)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    sys.stdout.write("heard")
    assert "heard" in capsys.readouterr().out
