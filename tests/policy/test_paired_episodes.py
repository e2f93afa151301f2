"""Two policies in the same episodes, as many as there is time for."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.clocks import Stopped, Ticking
from helpers.toys import toy
from helpers.umbrella import careless, voting

from mdpo_rddl.planner.exact.exact import LOST
from mdpo_rddl.policy import paired_episodes as module
from mdpo_rddl.policy.paired_episodes import MOST, paired_returns
from mdpo_rddl.problem.evaluation import episode_seeds, mean_and_error

PROBLEM = toy("umbrella")


def test_both_play_the_same_episodes():
    same = paired_returns(PROBLEM, (careless(), careless()), 1000.0, Stopped())
    assert same.shape == (MOST, 2)
    assert same[:, 0].tolist() == same[:, 1].tolist()
    assert len(np.unique(same[:, 0])) > 3
    other = paired_returns(PROBLEM, (careless(), careless()), 1000.0, Stopped(), seed=1)
    assert other[:, 0].tolist() != same[:, 0].tolist()


def test_they_are_none_of_an_evaluation(monkeypatch):
    seeds = []

    def noted(env, policy, episodes, seed):
        seeds.extend(episode_seeds(seed, episodes))
        return SimpleNamespace(worth=[0.0])

    monkeypatch.setattr(module, "evaluate", noted)
    for seed in range(3):
        paired_returns(PROBLEM, (careless(),), 1000.0, Stopped(), seed=seed)
    assert len(set(seeds)) == 3 * MOST
    evaluated = {one for seed in range(3 * MOST) for one in episode_seeds(seed, 50)}
    assert evaluated.isdisjoint(seeds)


def test_a_clear_gain_ends_them():
    both = voting(), careless()
    # what is clear at once may be luck
    assert len(paired_returns(PROBLEM, both, 1000.0, Stopped())) == 20
    returns = paired_returns(PROBLEM, both, 1000.0, Stopped(), least=5)
    assert 5 <= len(returns) < 20
    gain, error = mean_and_error(returns[:, 0] - returns[:, 1])
    assert gain > 4.0 * error


@pytest.mark.parametrize(("until", "count"), [(0.5, 0), (1.5, 1), (4.5, 3)])
def test_none_is_begun_that_would_end_late(until, count):
    returns = paired_returns(PROBLEM, (careless(), careless()), until, Ticking(1.0))
    assert returns.shape == (count, 2)


def test_an_episode_in_which_the_environment_fails_is_lost():
    kettle = toy("kettle", TERMINATION="false")
    heating, cooling = (lambda step, state: {}), (lambda step, state: {"cool": True})
    returns = paired_returns(kettle, (heating, cooling), 1000.0, Stopped(), least=3)
    assert set(returns[:, 0]) == {LOST}
    assert returns[:, 1].tolist() == pytest.approx([-4.0] * len(returns))


def test_the_error_is_that_of_a_mean():
    assert mean_and_error(np.array([1.0, 3.0, 5.0, 7.0])) == pytest.approx((4.0, 1.2909944))
