"""Single changes of the no-op, where each action has few values."""

import jax.numpy as jnp
import numpy as np
import pytest
from helpers.toys import toy

from mdpo_rddl.planner.build import build_planner
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.plans.single_changes import SingleChanges
from mdpo_rddl.problem.load import load_problem

WORDS = {"LEAST": "-1", "LARGEST": "1", "MOST": "pos-inf"}
CONFIG = auto_preset("").without_section("Search")


def exact(problem):
    return build_planner(problem, CONFIG).planner.test_compiled


@pytest.fixture(scope="module")
def changes():
    """Of turn(d1) and turn(d2) to -1 and 1, of paint to red and blue, and of ring."""
    return SingleChanges.of(exact(toy("dials", **WORDS)))


def listed(actions):
    return {name: np.asarray(value).tolist() for name, value in actions.items()}


def test_each_component_has_its_other_values(changes):
    assert changes.size == 7
    assert changes.numbers == ["turn", "paint"]
    assert listed(changes.noop) == {"turn": [0, 0], "paint": 1, "ring": False}
    # ring has one other value
    assert changes.places.tolist() == [[0, 1], [2, 3], [4, 5], [6, 7]]
    alone = [listed(changes.made(row)) for row in jnp.eye(7, dtype=bool)]
    assert [each["turn"] for each in alone[:5]] == [[-1, 0], [1, 0], [0, -1], [0, 1], [0, 0]]
    assert [each["paint"] for each in alone[3:]] == [1, 0, 2, 1]
    assert [each["ring"] for each in alone[5:]] == [False, True]


def test_changes_of_several_components_are_made_together(changes):
    made = changes.made(jnp.array([1, 0, 0, 1, 0, 1, 1], bool))
    assert listed(made) == {"turn": [-1, 1], "paint": 2, "ring": True}
    assert {name: value.dtype for name, value in made.items()} == {
        name: value.dtype for name, value in changes.noop.items()
    }


def test_the_best_change_of_each_component_is_found(changes):
    most, values = changes.best(jnp.array([1.0, 2.0, -3.0, -4.0, 0.5, 0.25, -1.0]))
    assert listed(most) == {"turn": [2.0, -3.0], "paint": 0.5, "ring": -1.0}
    assert listed(values) == {"turn": [1, -1], "paint": 0, "ring": True}


def test_what_is_nearer_to_a_proposal_is_liked(changes):
    proposed = {"turn": jnp.array([0.75, -0.25]), "paint": jnp.array(1.75), "ring": jnp.array(-2.0)}
    liked = changes.like(proposed)
    np.testing.assert_allclose(liked, [-1.0, 0.5, -0.5, -1.0, -1.0, 0.5, -2.0])
    most, values = changes.best(liked)
    assert [float(each) > 0.0 for each in (*most["turn"], most["paint"])] == [True, False, True]
    assert listed(values)["paint"] == 2


@pytest.mark.parametrize(("least", "largest"), [("-1.5", "1.5"), ("-0.0", "0.9")])
def test_values_are_whole_and_in_their_box(least, largest):
    found = SingleChanges.of(exact(toy("dials", **WORDS | {"LEAST": least, "LARGEST": largest})))
    moved = found.made(jnp.arange(found.size) == 0)["turn"][0]
    assert int(moved) == (-1 if least == "-1.5" else 0)


def test_many_values_are_none():
    assert SingleChanges.of(exact(toy("dials", **WORDS | {"LARGEST": "62"}))).size == 2 * 63 + 3
    assert SingleChanges.of(exact(toy("dials", **WORDS | {"LARGEST": "63"}))) is None
    assert SingleChanges.of(exact(load_problem("SupplyChain_or", "0"))) is None  # unbounded
    assert SingleChanges.of(exact(load_problem("Reservoir_ippc2023", "1"))) is None  # real
