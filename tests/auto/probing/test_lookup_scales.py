"""What a policy looks up, by the states that probing has seen."""

import numpy as np
import pytest
from helpers.lakes import preset
from helpers.probes import probed
from helpers.vans import vans

from mdpo_rddl.auto.probing.fitting import greedy, scaled, without_scales
from mdpo_rddl.auto.probing.lookup_scales import lookup_scales
from mdpo_rddl.planner.build import build_planner

PLACES = np.array([[0, 1], [1, 2], [2, 0], [0, 0]])
WAITS = np.array([[1, 2, 3], [5, 3, 4], [7, 2, 9], [4, 4, 4]])


@pytest.fixture(scope="module")
def bare():
    return build_planner(vans(), without_scales(preset(1.0))).planner


def seen(hours):
    """Four states of one rollout."""
    return {
        "clock": [np.array(hours).reshape(1, 1, 4)],
        "at": [PLACES.reshape(1, 1, 4, 2)],
        "waits": [WAITS.reshape(1, 1, 4, 3)],
        "open": [np.ones((1, 1, 4, 3), bool)],
    }


SCALES = {"waits": (4.0, 2.5)}


def test_what_changes_with_the_state_is_read(bare):
    found = lookup_scales(bare, seen([0, 1, 0, 0]), SCALES)
    # the load at two hours is the hour in other units, and all places are open
    assert set(found) == {"waits(at(?van))", "LIMIT(at(?van), ?van)"}
    # in the units of what is looked up; a constant has none
    assert found["waits(at(?van))"] == SCALES["waits"]
    limits = np.array([[2, 2], [2, 2], [7, 3], [2, 3]])
    assert found["LIMIT(at(?van), ?van)"] == pytest.approx((np.mean(limits), np.std(limits)))


def test_bools_have_the_units_of_bools(bare):
    states = seen([0, 1, 0, 0])
    states["open"] = [np.ones((1, 1, 4, 3), bool)]
    states["open"][0][0, 0, 1, 2] = False
    assert lookup_scales(bare, states, SCALES)["open(at(?van))"] == (0.5, 0.5)


def test_objects_that_differ_always_are_told_apart_by_what_changes(bare):
    states = seen([0, 1, 0, 0])
    offsets = np.array([0, 1000, 2000])
    states["at"] = [np.tile([0, 1], (1, 1, 4, 1))]
    states["waits"] = [(offsets + np.array([[0], [1], [0], [3]])).reshape(1, 1, 4, 3)]
    # each van stays where it is, and sees one place's number change
    assert "waits(at(?van))" in lookup_scales(bare, states, SCALES)


def test_there_are_at_most_so_many(bare, monkeypatch):
    monkeypatch.setattr("mdpo_rddl.auto.probing.lookup_scales._MOST", 1)
    assert len(lookup_scales(bare, seen([0, 1, 0, 0]), SCALES)) == 1


def test_the_preset_reads_what_probing_has_found(bare):
    found = probed(bare, seed=0)
    assert "waits(at(?van))" in found.lookup_scales
    config = scaled(preset(1.0), found)
    assert config.policy_arguments["lookups"] == list(found.lookup_scales)
    planner = build_planner(vans(), config.without_section("Search")).planner
    assert "waits(at(?van))^2" in planner.feedback_plan.feedback.names("go")


@pytest.mark.parametrize("lookups", [[], ["LOAD(clock)"]])
def test_what_a_configuration_says_is_kept(bare, lookups):
    found = probed(bare, seed=0)
    config = scaled(preset(1.0).with_policy_arguments(lookups=lookups), found)
    assert config.policy_arguments.get("lookups", []) == lookups
    assert set(config.policy_arguments["state_scales"]) <= {*found.state_scales, *lookups}


def test_what_learns_a_value_reads_the_state_alone(bare):
    found = probed(bare, seed=0)
    config = scaled(preset(1.0), found).without_section("Search")
    plan = greedy(config).policy_arguments
    assert set(plan["state_scales"]) == set(found.state_scales)
