"""Every function of RDDL in the ground model, at the edges too: the environment's values."""

import numpy as np
import pytest
from helpers.functions import (
    BEYOND_THE_GROUND,
    EXPRESSIONS,
    in_the_environment,
    one_by_one,
    states_one_by_one,
)

from mdpo_rddl.problem.enumeration.limits import EnumerationLimits, NotEnumerableError
from mdpo_rddl.problem.enumeration.model import open_model
from mdpo_rddl.problem.enumeration.program import Program
from mdpo_rddl.problem.enumeration.sampling import GroundSampler

LIMITS = EnumerationLimits(1e9)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_their_values_are_the_environment_s():
    expressions = list(EXPRESSIONS.values())
    model, states = open_model(one_by_one(expressions), LIMITS), states_one_by_one(len(expressions))
    sampler, right = GroundSampler(model), in_the_environment(expressions)
    actions, uniform = np.zeros((1, states.shape[1])), np.zeros((sampler.draws, states.shape[1]))
    leaves = {model.leaf(number): row for number, row in enumerate(states)}
    reward = model.rules.reward
    for found in (
        sampler.step(states, actions, uniform).rewards,  # all of them as floats
        Program(model.graph, [reward]).run(leaves)[reward],  # whole ones as such
    ):
        pairs = zip(EXPRESSIONS, found.reshape(right.shape), right, strict=True)
        wrong = [
            name
            for name, ours, theirs in pairs
            if not np.allclose(ours, theirs, rtol=1e-9, atol=1e-12, equal_nan=True)
        ]
        assert wrong == []


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_constants_are_folded_to_the_same_values():
    expressions = list(EXPRESSIONS.values())
    model, states = open_model(one_by_one(expressions), LIMITS), states_one_by_one(len(expressions))
    right = np.ravel(in_the_environment(expressions))
    graph, wrong = model.graph, []
    # a stride that meets all points and all expressions in turn
    for column in range(0, states.shape[1], 31):
        values = {
            model.leaf(number): graph.constant(int(value))
            for number, value in enumerate(states[:, column])
        }
        (folded,) = graph.substitute([model.rules.reward], values)
        if not np.isclose(graph.values[folded], right[column], rtol=1e-9, equal_nan=True):
            wrong.append((expressions[states[3, column]], graph.values[folded], right[column]))
    assert wrong == []


@pytest.mark.parametrize("name", BEYOND_THE_GROUND)
def test_what_is_not_understood_is_refused(name):
    with pytest.raises(NotEnumerableError, match="not understood"):
        open_model(one_by_one([BEYOND_THE_GROUND[name]]), LIMITS)
