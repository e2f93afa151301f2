"""Search by trials on problems whose optimum is known."""

import numpy as np
import pytest
from helpers import toy_mdps as toys
from helpers.clocks import Ticking
from helpers.toys import toy

from mdpo_rddl.auto.search.optimum import find_optimum
from mdpo_rddl.auto.search.tables import action_table
from mdpo_rddl.auto.search.trials.backward import induct
from mdpo_rddl.auto.search.trials.playing import play, runs
from mdpo_rddl.auto.search.trials.trials import TrialSearch
from mdpo_rddl.policy.table import Estimate
from mdpo_rddl.policy.table_policy import TablePolicy
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits
from mdpo_rddl.problem.enumeration.model import ground_model
from mdpo_rddl.problem.evaluation import evaluate
from mdpo_rddl.problem.load import make_environment

LIMITS = EnumerationLimits(seconds=1e9, clock=Ticking())


def searched(problem, seconds, seed=0):
    """A search that has worked for so many looks at the clock."""
    search = TrialSearch(ground_model(problem, LIMITS), LIMITS, seed, Ticking(1.0))
    search.work(seconds)
    return search


@pytest.fixture(scope="module")
def problem():
    return toy("quest")


@pytest.fixture(scope="module")
def search(problem):
    return searched(problem, 120.0)


@pytest.fixture(scope="module")
def optimum(problem):
    return find_optimum(problem, 60.0)


def test_time_is_left_for_inductions_over_what_was_seen(problem):
    clock, expected = Ticking(1.0), []
    search = TrialSearch(ground_model(problem, LIMITS), LIMITS, 0, clock)

    def to_be_left(induction):
        expected.append(induction)
        return 40.0

    search.work(120.0, to_be_left=to_be_left)
    # a batch looks at the clock a few times after its end
    assert 80.0 <= clock.now < 90.0
    # a guess by the rows at first, then the clock's seconds
    assert 0.0 < expected[0] < 0.1 < expected[-1]


@pytest.mark.parametrize("trust", [0.0, 0.9])
def test_it_finds_the_optimum_of_a_problem_that_pays_only_at_a_goal(search, optimum, trust):
    greedy = search.found(trust)
    assert optimum.value > 5.0
    assert greedy.value == pytest.approx(optimum.value, rel=1e-6)
    played = play(search.explored, greedy, 2000, 0)
    error = np.std(played.returns) / np.sqrt(2000)
    assert played.returns.mean() == pytest.approx(optimum.value, abs=4.0 * error)
    assert error > 0.0
    assert played.missed == 0.0


def test_without_trust_a_part_is_worth_no_more_than_the_whole(problem, optimum, monkeypatch):
    monkeypatch.setattr("mdpo_rddl.auto.search.trials.trials._TRIALS", 4)
    monkeypatch.setattr("mdpo_rddl.auto.search.trials.explored._FEW", 0)
    explored = searched(problem, 20.0).explored
    assert explored.size < optimum.optimum.states
    # the best that was drawn is taken to be all that there is, or to lead nowhere
    assert 0.0 < induct(explored, 0.0).value < optimum.value < induct(explored, 1.0).value


def test_an_induction_over_many_rows_looks_at_the_clock(search, monkeypatch):
    looks = []
    induct(search.explored, 0.0, lambda: looks.append(0))
    assert not looks  # it takes less than a millisecond
    monkeypatch.setattr("mdpo_rddl.auto.search.trials.backward._ROWS_UNTIMED", 0)
    induct(search.explored, 0.0, lambda: looks.append(0))
    assert len(looks) == search.explored.model.horizon


def test_the_discount_and_the_steps_left_count(tmp_path):
    lamp = toys.lamp(tmp_path, 3, 0.5)
    expected = find_optimum(lamp, 60.0).value
    assert searched(lamp, 100.0).found(0.0).value == pytest.approx(expected, abs=1e-12)


def test_an_episode_that_ends_is_not_gone_on_with(tmp_path):
    gambler = toys.gambler(tmp_path, 4)
    search = searched(gambler, 100.0)
    greedy = search.found(0.0)
    assert greedy.value == pytest.approx(find_optimum(gambler, 60.0).value, abs=1e-12)
    ended = search.explored.row_count.values == 0
    assert ended.any()
    assert np.all(greedy.rows[:, ended] == -1)
    played = play(search.explored, greedy, 500, 0)
    # a stake's expected reward is 0.4 in the step in which it may win
    assert played.returns.max() <= 0.4 + 0.4
    assert played.returns.mean() == pytest.approx(greedy.value, abs=0.06)


def test_the_same_seed_sees_the_same(problem):
    one, other, third = (searched(problem, 20.0, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.explored.index.states, other.explored.index.states)
    assert not np.array_equal(one.explored.tried.values, third.explored.tried.values)


def test_known_transitions_have_the_model_s_probabilities(search):
    explored = search.explored
    total = np.bincount(explored.origin.values, explored.probability.values)
    seen = np.bincount(explored.origin.values) > 0
    assert np.all(total[seen] <= 1.0 + 1e-12)
    # two outcomes are few: both are there once one was drawn
    np.testing.assert_allclose(total[seen], 1.0)
    assert np.bincount(explored.origin.values).max() == 2


def test_joined_states_keep_all_their_probability(tmp_path):
    # once at the goal the weather, drawn by halves, no longer matters
    search = searched(toys.walk(tmp_path, 6), 60.0)
    explored = search.explored
    assert explored.merges
    total = np.bincount(explored.origin.values, explored.probability.values)
    assert total.max() <= 1.0 + 1e-12
    assert search.found(0.0).value == pytest.approx(-2.9375, abs=1e-9)


def test_its_memory_is_bounded(problem, monkeypatch):
    monkeypatch.setattr("mdpo_rddl.auto.search.trials.trials._MOST_STATES", 10)
    search = searched(problem, 1e6)
    assert search.is_full
    assert 10 < search.explored.size < 40


def test_a_table_of_it_is_played_as_it_was_simulated(problem, search, tmp_path):
    explored, greedy = search.explored, search.found(0.0)
    table = action_table(
        problem,
        explored.model,
        explored.merges,
        explored.index.states,
        runs(explored, greedy),
    )
    played = play(explored, greedy, 500, 0)
    estimate = Estimate(played.returns.mean(), 0.1, 500, played.missed, explored.size)
    policy = TablePolicy(problem, table, estimate, 0)
    assert policy.optimum is None
    assert policy.returns == pytest.approx([estimate.value])
    evaluation = evaluate(make_environment(problem), policy, episodes=30, seed=0)
    error = evaluation.std / np.sqrt(30)
    assert evaluation.mean == pytest.approx(estimate.value, abs=4.0 * error)
    assert policy.misses == 0


def test_the_clock_is_looked_at_more_often_where_nothing_is_known(problem):
    model, looks = ground_model(problem, LIMITS), []
    search = TrialSearch(model, LIMITS, 0, Ticking())
    idle = search.found(0.0)
    # that knows no state at all
    blind = idle._replace(rows=idle.rows[:, :0])
    # of 128 episodes, after each second step
    for greedy, missed, count in ((idle, 0.0, 0), (blind, 1.0, (model.horizon - 1) // 2)):
        looks.clear()
        played = play(search.explored, greedy, 128, 0, check_time=lambda: looks.append(1))
        assert (played.missed, len(looks)) == (missed, count)


def test_what_a_search_has_not_seen_is_missed_and_left_idle(problem):
    search = TrialSearch(ground_model(problem, LIMITS), LIMITS, 0, Ticking())
    played = play(search.explored, search.found(0.0), 20, 0)
    # nothing is known to be of use: the initial state is never left
    np.testing.assert_array_equal(played.returns, np.zeros(20))
