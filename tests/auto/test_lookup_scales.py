"""What a policy looks up, by the states that probing has seen."""

import numpy as np
import pytest
from helpers.lakes import preset
from helpers.probes import probed
from helpers.vans import vans

from mdpo_rddl.auto.fitting import scaled, without_scales
from mdpo_rddl.auto.lookup_scales import lookup_scales
from mdpo_rddl.auto.probing import Probe
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


def test_what_changes_with_the_state_is_read(bare):
    found = lookup_scales(bare, seen([0, 1, 0, 0]))
    # the load at two hours is the hour in other units, and all places are open
    assert set(found) == {"waits(at(?van))", "LIMIT(at(?van), ?van)"}
    waits = np.take_along_axis(WAITS, PLACES, axis=1)
    assert found["waits(at(?van))"] == pytest.approx((np.mean(waits), np.std(waits)))


def test_the_preset_reads_what_probing_has_found(bare):
    found = probed(bare, seed=0)
    assert "waits(at(?van))" in found.lookup_scales
    assert found.fits(bare)
    assert Probe.of(found.state()).lookup_scales == found.lookup_scales
    config = scaled(preset(1.0), found)
    assert config.policy_arguments["lookups"] == list(found.lookup_scales)
    planner = build_planner(vans(), config.without_section("Search")).planner
    assert "waits(at(?van))^2" in planner.feedback_plan.feedback.names("go")
