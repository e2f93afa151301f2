"""What a candidate knows of those that it was made from."""

from dataclasses import replace

from helpers.lakes import preset

from mdpo_rddl.auto.common.candidate import Candidate


def test_a_child_knows_whom_it_was_made_from():
    config = preset(1.0)
    first = Candidate("plan", "plan", config, None, {}, mean=1.0)
    child = replace(first.child("gradient", "phase 1", {}), uses_noise=True, mean=2.0)
    last = child.child("plan", "polished", {}).child("own weights", "polished", {})
    assert last.parents == ("plan", "gradient")
    assert last.uses_noise
    assert last.mean is None
