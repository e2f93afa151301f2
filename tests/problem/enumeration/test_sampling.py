"""Next states that are drawn side by side, against the laws."""

import numpy as np
import pytest
from helpers import toy_mdps as toys
from helpers.couriers import courier

from mdpo_rddl.problem.enumeration.graph import Graph, Kind
from mdpo_rddl.problem.enumeration.layered_program import LayeredProgram
from mdpo_rddl.problem.enumeration.limits import EnumerationLimits
from mdpo_rddl.problem.enumeration.model import open_model
from mdpo_rddl.problem.enumeration.operators import REDUCED
from mdpo_rddl.problem.enumeration.sampling import GroundSampler
from mdpo_rddl.problem.load import load_problem

LIMITS = EnumerationLimits(1e9)


def spread(model, actions, count):
    """So many copies of the initial state and of an action."""
    first = np.array([int(value) for value in model.first])
    return np.repeat(first[:, np.newaxis], count, 1), np.repeat(actions[:, np.newaxis], count, 1)


@pytest.mark.parametrize("operator", sorted(REDUCED))
def test_many_arguments_are_put_together_as_few_are(operator):
    graph, generator = Graph(), np.random.default_rng(0)
    is_bool = operator in ("and", "or")
    leaves = [graph.leaf(Kind.STATE, number, is_bool) for number in range(40)]
    values = generator.random((40, 500))
    # of some columns all are true, of some none is
    values = values < 0.5 ** generator.integers(-9, 9, 500) if is_bool else 0.5 + values
    given = dict(zip(leaves, values, strict=True))
    wide, narrow = graph.make(operator, *leaves), leaves[0]
    for leaf in leaves[1:]:
        narrow = graph.make(operator, narrow, leaf)
    found = LayeredProgram(graph, [wide, narrow]).run(given, 500)
    np.testing.assert_allclose(found[wide], found[narrow], rtol=1e-12)
    assert len(set(found[wide])) > 1


def test_a_pick_works_as_often_as_it_should():
    model = open_model(courier(), LIMITS)
    sampler = GroundSampler(model)
    pick = [name for name, _ in model.actions].index("pick")
    actions = np.zeros(3, int)
    actions[pick] = 1
    given = spread(model, actions, 4000)
    uniform = np.random.default_rng(0).random((sampler.draws, 4000))
    stepped = sampler.step(*given, uniform)
    assert sampler.is_random
    assert stepped.states[3].mean() == pytest.approx(0.8, abs=0.03)
    np.testing.assert_array_equal(stepped.states[:3], given[0][:3])
    assert not stepped.ends.any()
    assert sampler.legal(*given).all()
    assert not sampler.legal(np.roll(given[0], 1, axis=0), given[1]).any()


def test_what_shares_a_draw_is_drawn_together(tmp_path):
    model = open_model(toys.shared_draw(tmp_path), LIMITS)
    sampler = GroundSampler(model)
    states, actions = spread(model, np.array([1]), 3000)
    uniform = np.random.default_rng(1).random((sampler.draws, 3000))
    left, right = sampler.step(states, actions, uniform).states
    np.testing.assert_array_equal(left, right)
    assert left.mean() == pytest.approx(0.5, abs=0.03)
    # without a flip neither is true
    assert not sampler.step(states, 0 * actions, uniform).states.any()


def test_objects_are_drawn_by_their_weights():
    model = open_model(load_problem("ChromaticDice_ippc2018", "1"), LIMITS)
    sampler = GroundSampler(model)
    assert sampler.draws >= len(model.variables)
    noop = np.array([int(default) for default, _ in model.actions.values()], int)
    states, actions = spread(model, noop, 8)
    uniform = np.random.default_rng(2).random((sampler.draws, 8))
    stepped = sampler.step(states, actions, uniform)
    for number, kind in enumerate(model.ranges):
        if kind in model.objects:
            assert set(stepped.states[number]) <= set(range(len(model.objects[kind])))
