"""What is no step and no observation of a problem is refused in one line."""

from typing import Any

import numpy as np
import pytest
from helpers.mistakes import one_line
from helpers.vans import vans

from mdpo_rddl.problem.grounding import require_batch, require_observation, require_step
from mdpo_rddl.problem.load import make_environment

PROBLEM = vans()
MODEL = PROBLEM.model
STATE = dict(make_environment(PROBLEM).reset(seed=0)[0])
FLUENTS = sorted(STATE)


@pytest.mark.parametrize("step", [-1, 0.5, 1.0, True, None, "0", MODEL.horizon, 10**6])
def test_steps_that_are_none(step: Any) -> None:
    said = one_line(lambda: require_step(MODEL, step))
    assert said == f"the step must be an integer from 0 to {MODEL.horizon - 1}, got {step!r}"


@pytest.mark.parametrize("step", [0, MODEL.horizon - 1, np.int64(1)])
def test_steps(step: Any) -> None:
    require_step(MODEL, step)


@pytest.mark.parametrize("name", FLUENTS)
def test_a_missing_fluent_is_named(name: str) -> None:
    rest = {each: value for each, value in STATE.items() if each != name}
    assert one_line(lambda: require_observation(MODEL, rest)) == f"the observation lacks {name}"


@pytest.mark.parametrize("value", [None, [1, 2], 3, "state"])
def test_what_is_no_mapping(value: Any) -> None:
    said = one_line(lambda: require_observation(MODEL, value))
    assert said.startswith("the observation must be a mapping of fluents to values, got ")
    assert said.endswith(type(value).__name__)


@pytest.mark.parametrize("name", FLUENTS)
def test_another_shape_is_named(name: str) -> None:
    wrong = {**STATE, name: np.zeros((7, 9))}
    said = one_line(lambda: require_observation(MODEL, wrong))
    assert said.startswith(f"the observation has {name} of shape (7, 9), it must be ")


def test_what_is_no_array_and_what_is_unknown() -> None:
    name = FLUENTS[0]
    ragged = {**STATE, name: [[1, 2], [3]]}
    assert f"has {name} that is no array" in one_line(lambda: require_observation(MODEL, ragged))
    said = one_line(lambda: require_observation(MODEL, {**STATE, "moon": np.zeros(2)}))
    assert said == "the observation has the unknown fluent moon"


@pytest.mark.parametrize("name", FLUENTS)
def test_words_are_no_values(name: str) -> None:
    wrong = {**STATE, name: np.full(np.shape(STATE[name]), "nowhere")}
    said = one_line(lambda: require_observation(MODEL, wrong))
    assert said.startswith(f"the observation has {name} that is no ")


def test_an_observation_of_the_environments_is_one_by_itself_and_side_by_side() -> None:
    require_observation(MODEL, STATE)
    both = {name: np.stack([value, value]) for name, value in STATE.items()}
    assert require_batch(MODEL, 0, both) == 2
    one_line(lambda: require_batch(MODEL, 0, {}))
    one_line(lambda: require_batch(MODEL, 0, {n: value[:0] for n, value in both.items()}))
