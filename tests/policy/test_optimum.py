"""Optima that are known by hand, and the policies that attain them."""

import numpy as np
import pytest
from helpers import toy_mdps as toys
from helpers.tanks import DOMAIN, INSTANCE
from helpers.toys import problem_from, toy, toy_text

from mdpo_rddl.policy import optimum
from mdpo_rddl.policy.lookahead.table_lookup import TableLookup
from mdpo_rddl.policy.optimum import find_optimum
from mdpo_rddl.problem.enumeration.limits import NotEnumerableError
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import load_problem, make_environment


@pytest.mark.parametrize(
    ("horizon", "discount", "value"),
    [
        (1, 1.0, 0.0),
        # press once: half of one step, an eighth paid
        (2, 1.0, -0.125 + 0.5),
        # pressed and lit: 1.75 in two steps left; pressed without effect: 0.375
        (3, 1.0, -0.125 + 0.5 * 1.75 + 0.5 * 0.375),
        (3, 0.5, -0.125 + 0.5 * (0.5 * (1 + 0.5 * 0.75) + 0.5 * 0.125)),
    ],
)
def test_a_chain_of_two_states(tmp_path, horizon, discount, value):
    solution = find_optimum(toys.lamp(tmp_path, horizon, discount), 30)
    assert solution.value == pytest.approx(value, abs=1e-12)
    assert solution.optimum.states <= 2


@pytest.mark.parametrize(("horizon", "value"), [(1, 0.0), (2, 0.16), (5, 0.4 * (0.4 + 0.6 * 0.16))])
def test_a_gambler_whose_reward_depends_on_the_next_state(tmp_path, horizon, value):
    # from one: 0.4 to two; from two: 0.4 to three, else back to one; two at once overshoots
    solution = find_optimum(toys.gambler(tmp_path, horizon), 30)
    assert solution.value == pytest.approx(value, abs=1e-12)


@pytest.mark.parametrize(("horizon", "value"), [(2, -2.0), (3, -2.5), (6, -2.9375)])
def test_a_walk_with_an_enum_drawn_at_random(tmp_path, horizon, value):
    solution = find_optimum(toys.walk(tmp_path, horizon), 30)
    assert solution.value == pytest.approx(value, abs=1e-12)


def test_what_no_longer_matters_makes_no_states(tmp_path):
    # cells one and two, wet or dry, and the goal, where the sky does not matter
    solution = find_optimum(toys.walk(tmp_path, 6), 30)
    assert solution.optimum.states == 5
    assert solution.optimum.actions == 2  # dancing changes nothing


def test_the_values_of_later_steps_are_those_of_shorter_horizons(tmp_path):
    table = find_optimum(toys.lamp(tmp_path, 6, 0.9), 30, keeps_values=True).table
    lookup = TableLookup(table)
    dark = {"on": np.array([False])}
    found = [float(lookup.value(lookup.arrays, step, dark)) for step in range(8)]
    shorter = [find_optimum(toys.lamp(tmp_path, left, 0.9), 30).value for left in range(6, 0, -1)]
    np.testing.assert_allclose(found, [*shorter, 0.0, 0.0], rtol=1e-6)
    # what no one comes to is as bad as the worst that is known
    unknown = {"on": np.array([2])}
    assert float(lookup.value(lookup.arrays, 1, unknown)) == table.values[1].min() < found[1] + 1e-6
    assert float(lookup.value(lookup.arrays, 6, unknown)) == 0.0
    assert find_optimum(toys.lamp(tmp_path, 6, 0.9), 30).table.values is None


def test_values_that_are_too_many_are_not_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(optimum, "_MOST_VALUES", 11)
    problem = toys.lamp(tmp_path, 6)
    assert find_optimum(problem, 30, keeps_values=True).table.values is None


@pytest.mark.parametrize("name", ["lamp", "gambler", "walk"])
def test_episodes_of_the_policy_return_the_optimum(tmp_path, name):
    problem = getattr(toys, name)(tmp_path, 5)
    solution = find_optimum(problem, 30)
    policy = solution.policy()
    env = make_environment(problem, enforce_action_constraints=True)
    evaluation = evaluate(env, policy, 400, 11)
    error = evaluation.std / np.sqrt(400)
    assert abs(evaluation.mean - solution.value) < 4 * error
    assert evaluation.illegal_actions == 0
    assert policy.misses == 0


def test_no_policy_returns_more_than_the_optimum(tmp_path):
    problem = toys.lamp(tmp_path, 4)
    always = evaluate(make_environment(problem), lambda step, state: {"press": True}, 400, 3)
    never = evaluate(make_environment(problem), lambda step, state: {}, 4, 3)
    optimum = find_optimum(problem, 30).value
    assert never.mean == 0.0
    assert always.ci95[1] < optimum


def test_real_states_are_given_up(tmp_path):
    (tmp_path / "d.rddl").write_text(DOMAIN)
    (tmp_path / "i.rddl").write_text(INSTANCE)
    problem = load_problem(str(tmp_path / "d.rddl"), str(tmp_path / "i.rddl"))
    with pytest.raises(NotEnumerableError, match="real"):
        find_optimum(problem, 30)


def test_fluents_that_share_a_draw_are_drawn_together(tmp_path):
    # both are on with half a chance at each of two steps; apart, with a quarter
    solution = find_optimum(toys.shared_draw(tmp_path), 30)
    assert solution.value == pytest.approx(1.0)
    assert solution.optimum.states == 2


def test_a_spent_time_is_given_up(tmp_path):
    with pytest.raises(NotEnumerableError, match="more than 0 s"):
        find_optimum(toys.walk(tmp_path, 3), 0)


def test_the_first_row_that_is_enough_is_found_for_each_state():
    random = np.random.default_rng(0)
    counts = random.integers(1, 6, 200)
    starts = np.cumsum(counts) - counts
    q = random.integers(0, 3, counts.sum()).astype(float)  # with ties
    enough = np.maximum.reduceat(q, starts)
    some = random.permutation(200)[:80]
    found = optimum._first_rows(q, enough[some], starts[some], counts[some])
    rows = [range(starts[each], starts[each] + counts[each]) for each in some]
    by_loop = [next(r for r in rs if q[r] >= enough[e]) for rs, e in zip(rows, some, strict=True)]
    assert found.tolist() == by_loop
    assert len(optimum._first_rows(q, enough[:0], starts[:0], counts[:0])) == 0


PIT = {"RISK": "1.0", "REST": "0.0", "FALLEN": "false", "DISCOUNT": "1.0"}


@pytest.mark.parametrize(
    ("changes", "horizon", "value"),
    [
        ({}, 4, 2 + 2 + 2 + 5),
        # what may happen by chance is avoided as well
        ({"RISK": "0.125"}, 4, 2 + 2 + 2 + 5),
        ({"RISK": "0.000001"}, 4, 2 + 2 + 2 + 5),
        # after the last step a fall is none
        ({"REST": "1.0"}, 1, 5),
        # no way out: 5 in the last step, or a fall before it, worth 2 (2 - 1) - 3 (2 + 1)
        ({"RISK": "0.5", "REST": "0.1"}, 2, 2 + 0.9 * 5 + 0.1 * -7),
        # the same discounted: 0.5 V = 2 (1.5 - 1) - 3 (1.5 + 1)
        ({"RISK": "0.5", "REST": "0.1", "DISCOUNT": "0.5"}, 2, 2 + 0.5 * (0.9 * 5 + 0.1 * -13)),
        # whatever is done: 5 now, and 2 (3 - 1) - 3 (3 + 1)
        ({"REST": "1.0"}, 3, 5 - 8),
    ],
)
def test_a_state_without_a_legal_action_is_avoided(changes, horizon, value):
    solution = find_optimum(problem_from(toy_text("pit", **PIT | changes), horizon), 30)
    assert solution.value == pytest.approx(value, abs=1e-9)


def test_an_optimum_that_no_policy_can_play_to_the_end_says_so(caplog):
    find_optimum(toy("pit", **PIT), 30)
    assert not caplog.records
    find_optimum(problem_from(toy_text("pit", **PIT | {"RISK": "0.5", "REST": "0.1"}), 3), 30)
    (told,) = (record.getMessage() for record in caplog.records)
    # flat twice, and the fall after the third step is none
    assert "cannot be avoided" in told
    assert "probability 0.19," in told


def test_an_empty_cistern_is_avoided():
    whole = {"KIND_OF_WATER": "int", "KIND_OF_BUY": "int", "KIND_OF_DRAW": "int"}
    problem = toy("cistern", START="2", **whole)
    solution = find_optimum(problem, 30)
    assert solution.value == 2 * 5 - 3 * 3  # two are there, three are bought
    evaluation = evaluate(make_environment(problem, True), solution.policy(), 2, 0)
    assert evaluation.returns.tolist() == [1.0, 1.0]
    assert evaluation.illegal_actions == 0
