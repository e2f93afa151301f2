"""Evolution of plans: it finds, it gives up, and it ends."""

import numpy as np
import pytest
from helpers.clocks import Ticking

from mdpo_rddl.auto.search.evolution import Breeding, Evaluation, Evolved, Goal, evolve
from mdpo_rddl.auto.search.mutations import layout_of

HORIZON = 12
PLAN = {"push": np.zeros((HORIZON, 2, 3)), "on": np.zeros((HORIZON, 4))}
LAYOUT = layout_of(PLAN, ["on"])


def generator(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def evolved(evaluate, start: float, population: int = 16, **goal) -> Evolved:
    """By a clock that ticks once an iteration, and once more after the first."""
    plans = np.full((1, HORIZON, 10), start, np.float32)
    breeding = Breeding(LAYOUT, population, generator(), clock=Ticking())
    return evolve(evaluate, plans, breeding, Goal(**({"return_to_beat": -np.inf} | goal)))


def test_evolution_finds_the_best_plan_of_a_bowl():
    target = generator(3).uniform(-0.8, 0.8, (HORIZON, 10))
    target[:, LAYOUT.is_bool] = np.sign(target[:, LAYOUT.is_bool])

    def evaluate(iteration, plans):
        return Evaluation(-np.sum((plans - target) ** 2, axis=(1, 2)), dict)

    result = evolved(evaluate, 0.0, population=64, until=500.0)
    assert result.best == evaluate(0, result.elites[:1]).returns[0]
    assert -result.best < 0.4 * np.sum(target**2)


def test_iterations_count_from_0_and_end_in_time():
    numbers = []

    def evaluate(iteration, plans):
        numbers.append(iteration)
        return Evaluation(-np.sum(plans**2, axis=(1, 2)), dict)

    result = evolved(evaluate, 1.0, until=22.0)
    assert numbers == list(range(result.iterations))
    assert result.iterations == 19
    assert not result.converged


@pytest.mark.parametrize("incumbent_return", [1e9, -np.inf])
def test_evolution_gives_up_where_it_would_not_catch_up(incumbent_return):
    def evaluate(iteration, plans):
        return Evaluation(-np.sum(plans**2, axis=(1, 2)), dict)

    result = evolved(evaluate, 1.0, until=300.0, incumbent_return=incumbent_return)
    if np.isfinite(incumbent_return):
        # after 30% of the time at the earliest
        assert 80 < result.iterations < 180
    else:
        assert result.iterations > 290


def test_evolution_goes_on_while_it_is_fast_enough():
    def evaluate(iteration, plans):
        # a better return by one an iteration
        return Evaluation(np.full(len(plans), float(iteration)), dict)

    fast = evolved(evaluate, 1.0, until=300.0, incumbent_return=250.0)
    assert fast.iterations > 290
    slow = evolved(evaluate, 1.0, until=300.0, incumbent_return=350.0)
    assert slow.iterations < 180


@pytest.mark.parametrize("until_converged", [False, True])
def test_evolution_ends_where_nothing_more_is_gained_if_it_shall(until_converged):
    def evaluate(iteration, plans):
        # as much as there is to gain is gained at once
        return Evaluation(np.where(np.any(plans != 0.0, axis=(1, 2)), 5.0, 0.0), dict)

    result = evolved(evaluate, 0.0, until=1000.0, until_converged=until_converged)
    assert result.converged is until_converged
    assert result.best == 5.0
    assert (result.iterations < 300) is until_converged


def test_it_says_after_each_iteration_which_plans_are_the_best():
    seen: list[np.ndarray] = []

    def evaluate(iteration, plans):
        return Evaluation(-np.sum((plans - 0.3) ** 2, axis=(1, 2)), dict)

    breeding = Breeding(LAYOUT, 16, generator(), clock=Ticking(), on_generation=seen.append)
    result = evolve(evaluate, np.zeros((1, HORIZON, 10)), breeding, Goal(12.0, -np.inf))
    assert len(seen) == result.iterations > 3
    np.testing.assert_array_equal(seen[-1], result.elites)
