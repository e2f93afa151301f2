"""The preset `auto`: a good policy from the RDDL alone."""

from mdpo_rddl.auto.options import RaceOptions
from mdpo_rddl.auto.outcome import RaceOutcome
from mdpo_rddl.auto.planning import plan_automatically

__all__ = ["RaceOptions", "RaceOutcome", "plan_automatically"]
