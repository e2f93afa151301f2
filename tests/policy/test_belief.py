"""The belief on the simulator: weights worked by hand, Bayes' rule, and what is elected."""

import math

import numpy as np
import pytest
from helpers.toys import toy
from helpers.umbrella import wet

from mdpo_rddl.policy.belief import BeliefFilter, elected, kernel, resampled, stepped
from mdpo_rddl.simulator.simulator import Simulator

HEARD = [True, True, False, True, False, False]


def test_particles_follow_bayes_rule_in_each_episode():
    count = 4096
    belief = BeliefFilter(Simulator(toy("umbrella")), 0, count)
    others = [not each for each in HEARD]
    now = belief.start(2)
    for step, both in enumerate(zip(HEARD, others, strict=True), 1):
        now = now._replace(actions={"take": np.zeros(2, bool)})
        now = belief.advance(now, step, {"patter": np.array(both)})
        share = now.particles["is-wet"].reshape(2, count).mean(axis=1)
        likely = [wet(heard[:step])[-1] for heard in (HEARD, others)]
        np.testing.assert_allclose(share, likely, atol=5.0 / math.sqrt(count))


def test_what_is_observed_for_certain_leaves_the_particles_that_agree():
    simulator = Simulator(toy("drift"))
    belief = BeliefFilter(simulator, 0, 4)
    start = belief.start(1)
    spread = np.array([0.5, 1.0, 1.5, 2.0])
    particles = {**start.particles, "x": np.stack([spread, spread])}
    noop = {name: value[..., np.newaxis] for name, value in simulator.noop.items()}
    # 0.9 x - 0.4 of the brake; what is seen is twice that
    seen = {"seen": np.full((2, 1), 2.0 * (0.9 * 1.5 - 0.4)), "far": np.array([True])}
    after = belief.advance(start._replace(particles=particles, actions=noop), 1, seen)
    assert np.bincount(np.round(after.particles["x"][0] * 100).astype(int)).argmax() == 95


def test_the_kernel_is_silverman_s():
    distances = np.array([[0.0, 1.0, -1.0, 2.0, np.nan]])
    width = 1.06 * np.std([0.0, 1.0, -1.0, 2.0]) * 5**-0.2
    expected = [-0.5 * (d / width) ** 2 for d in (0.0, 1.0, -1.0, 2.0)]
    np.testing.assert_allclose(kernel(distances)[0, :4], expected)
    # where all agree, only rounding may differ
    assert kernel(np.full((1, 3), 1e-6)).min() > -0.01


@pytest.mark.parametrize("uniform", [0.0, 0.4, 0.999])
def test_a_particle_comes_as_often_as_it_weighs(uniform):
    weights = np.array([[0.5, 0.25, 0.25, 0.0], [0.0, 0.0, 1.0, 0.0]])
    with np.errstate(divide="ignore"):
        places = resampled(uniform, np.log(weights)).reshape(2, 4)
    assert places.tolist() == [[0, 0, 1, 2], [6, 6, 6, 6]]


def test_episodes_have_the_same_numbers_however_many_there_are():
    simulator = Simulator(toy("umbrella"))
    chances = {}
    many = stepped(simulator, simulator.initial(3 * 50), {}, 7, 50, chances)
    one = stepped(simulator, simulator.initial(50), {}, 7, 50)
    assert np.array_equal(many.state["is-wet"], np.tile(one.state["is-wet"], 3))
    # of what is observed, too
    wet_ones = many.state["is-wet"]
    np.testing.assert_allclose(chances["patter"], np.where(wet_ones, 0.75, 0.1))


def test_the_most_frequent_action_is_elected_or_the_one_nearest_to_the_median():
    votes = np.array(
        [
            [[0.0, 1.0, 1.0, 0.0, 1.0], [1.0, 0.0, 1.0, 1.0, 0.0]],
            [[0.0, 0.0, 0.0, 1.0, 1.0], [1.0, 0.0, 1.0, 1.0, 0.0]],
        ]
    )
    assert elected(votes, is_joint=True).tolist() == [1, 0]
    # medians (1, 0.5): deviations say how far
    spread_out = np.array([[[0.0, 1.0, 2.0, 9.0]], [[0.0, 0.5, 0.4, 0.6]]])
    assert elected(spread_out, is_joint=False).tolist() == [1]
