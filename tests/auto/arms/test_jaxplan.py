"""JaxPlan's default planners in a second process."""

import time

import numpy as np
import pytest
from helpers.lakes import write_lake

from mdpo_rddl.auto.arms import jaxplan


@pytest.mark.slow
def test_the_second_process_trains_jaxplans_defaults(tmp_path, monkeypatch):
    monkeypatch.setattr(jaxplan, "usable_cores", lambda: 2)
    lake = write_lake(tmp_path)
    with jaxplan.Alternatives(lake, seed=0, seconds=12.0, wanted=True) as alternatives:
        assert alternatives.started
        arm = jaxplan.JaxPlanArm(alternatives, time.monotonic)
        arm.work(time.monotonic() + 100.0)
    (candidate,) = arm.take_candidates()
    assert candidate.label in {f"JaxPlan's default {method}" for method in jaxplan.METHODS}
    assert np.isfinite(candidate.known_mean)
    assert arm.log.iterations > 0
    assert not candidate.uses_noise
