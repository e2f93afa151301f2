"""Probabilities of the next state's bools, as a toy model states them."""

import jax
import numpy as np
import pytest
from helpers.toys import problem_from

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.plans.expectation import Expectation

DOMAIN = """
domain laws {
    types { thing : object; };
    pvariables {
        CHANCE(thing) : { non-fluent, real, default = 0.25 };
        lucky : { interm-fluent, bool };
        on(thing) : { state-fluent, bool, default = false };
        fixed : { state-fluent, bool, default = true };
        chosen(thing) : { state-fluent, bool, default = false };
        negated(thing) : { state-fluent, bool, default = false };
        either(thing) : { state-fluent, bool, default = false };
        both(thing) : { state-fluent, bool, default = false };
        after : { state-fluent, bool, default = false };
        some : { state-fluent, bool, default = false };
        count : { state-fluent, int, default = 0 };
        press(thing) : { action-fluent, bool, default = false };
    };
    cpfs {
        lucky = Bernoulli(0.5);
        on'(?x) = Bernoulli(CHANCE(?x));
        fixed' = ~fixed;
        chosen'(?x) = if (press(?x)) then KronDelta(on(?x)) else Bernoulli(0.125);
        negated'(?x) = ~Bernoulli(CHANCE(?x));
        either'(?x) = on(?x) | Bernoulli(CHANCE(?x)) | Bernoulli(0.5);
        both'(?x) = press(?x) ^ Bernoulli(CHANCE(?x)) ^ Bernoulli(0.5);
        after' = if (lucky) then Bernoulli(0.25) else Bernoulli(0.75);
        some' = exists_{?x : thing} [Bernoulli(CHANCE(?x))];
        count' = count + 1;
    };
    reward = sum_{?x : thing} [on(?x)];
}
non-fluents nf {
    domain = laws;
    objects { thing : {x1, x2}; };
    non-fluents { CHANCE(x2) = 0.75; };
}
instance one {
    domain = laws;
    non-fluents = nf;
    max-nondef-actions = pos-inf;
    horizon = 2;
    discount = 1.0;
}
"""


@pytest.fixture(scope="module")
def compiled():
    config = auto_preset("laws").without_section("Search")
    return build_planner(problem_from(DOMAIN), config).planner.test_compiled


@pytest.fixture(scope="module")
def expected(compiled):
    step = dict(compiled.init_values)
    step |= {
        "on": np.array([False, True]),
        "press": np.array([True, True]),
        "lucky": np.array(True),
    }
    return jax.jit(Expectation(compiled))(step)


@pytest.mark.parametrize(
    ("name", "chances"),
    {
        "on": [0.25, 0.75],
        "chosen": [0.0, 1.0],
        "negated": [0.75, 0.25],
        "either": [1.0 - 0.75 * 0.5, 1.0],
        "both": [0.125, 0.375],
        "after": 0.25,
    }.items(),
)
def test_each_law_has_its_probability(expected, name, chances):
    np.testing.assert_allclose(expected[name], chances)


def test_it_is_the_probability_of_the_branch_that_is_taken(compiled):
    found = jax.jit(Expectation(compiled))(compiled.init_values)
    np.testing.assert_allclose(found["chosen"], [0.125, 0.125])
    assert float(found["after"]) == 0.75


def test_what_is_certain_or_of_another_kind_is_left_to_the_sample(compiled):
    names = Expectation(compiled).names
    assert set(names) == {"on", "chosen", "negated", "either", "both", "after"}


def test_it_is_known_whether_more_is_drawn(compiled):
    assert not Expectation(compiled).is_whole  # whether it is lucky
    certain = DOMAIN.replace("lucky = Bernoulli(0.5);", "lucky = fixed;")
    config = auto_preset("laws").without_section("Search")
    readable = certain.replace("exists_{?x : thing} [Bernoulli(CHANCE(?x))]", "lucky")
    found = [
        Expectation(build_planner(problem_from(text), config).planner.test_compiled).is_whole
        for text in (certain, readable)
    ]
    assert found == [False, True]


def test_it_is_compiled_for_many_steps_at_once(compiled):
    step = {name: np.stack([value] * 3) for name, value in compiled.init_values.items()}
    step["press"] = np.array([[False, False], [True, False], [True, True]])
    found = jax.jit(jax.vmap(Expectation(compiled)))(step)
    np.testing.assert_allclose(found["both"], [[0.0, 0.0], [0.125, 0.0], [0.125, 0.375]])
