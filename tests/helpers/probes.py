"""Probings of a planner by a clock of their own."""

from typing import Any

from mdpo_rddl.auto.probing.probing import Probe, constants_for, probe
from mdpo_rddl.planner.planner import MDPOPlanner


def probed(planner: MDPOPlanner, seed: int = 0, **times: Any) -> Probe:
    """What constants show; the times are those of `constants_for`."""
    return probe(constants_for(planner, seed, **times), seed)
