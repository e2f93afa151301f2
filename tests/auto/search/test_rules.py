"""Random rules: how many are drawn, and which are kept."""

from types import SimpleNamespace

import numpy as np
from helpers.clocks import Stopped

from mdpo_rddl.auto.search.rules import Drawing, random_rules

POPULATION = 16
RULES = SimpleNamespace(start=np.zeros(4))


class Rollouts:
    """A population returns each rule's first weight, after 0.01 seconds."""

    population = POPULATION

    def __init__(self) -> None:
        self.clock, self.played = Stopped(), []

    def __call__(self, rules, iteration, vectors):
        self.clock.now += 0.01
        self.played.append(vectors)
        return np.where(vectors[:, 1] > 0.0, np.nan, vectors[:, 0])


def drawn(seed: int = 0, **values):
    rollouts = Rollouts()
    drawing = Drawing(clock=rollouts.clock, **values)
    found = random_rules(rollouts, RULES, np.random.default_rng(seed), drawing)
    assert found.populations == len(rollouts.played)
    vectors = np.concatenate(rollouts.played)
    # one that returns no number exceeds nothing
    paid = (vectors[:, 0] > drawing.to_beat) & (vectors[:, 1] <= 0.0)
    assert found.paid_share == paid.mean()
    return found.kept, vectors


def test_the_best_are_kept_and_those_that_return_no_number_are_not():
    kept, vectors = drawn(count=100, to_beat=-1.0)
    assert len(vectors) == 112  # whole populations
    finite = vectors[vectors[:, 1] <= 0.0]
    best = np.sort(finite[:, 0])[::-1][:POPULATION]
    np.testing.assert_array_equal([rule.mean for rule in kept], best)
    np.testing.assert_array_equal([rule.vector[0] for rule in kept], best)


def test_it_ends_in_time_with_one_population_at_least():
    assert len(drawn(until=0.035)[1]) == 4 * POPULATION
    assert len(drawn(until=-1.0)[1]) == POPULATION


def test_many_weights_are_zero_and_the_generator_decides():
    vectors = drawn()[1]
    assert 0.4 < np.mean(vectors == 0.0) < 0.6
    np.testing.assert_array_equal(drawn()[1], vectors)
    assert np.any(drawn(seed=1)[1] != vectors)
