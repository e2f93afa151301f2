"""The preset `auto`: a good policy from the RDDL alone."""

from mdpo_rddl.auto.outcome.outcome import RaceOutcome
from mdpo_rddl.auto.planning import plan_automatically
from mdpo_rddl.auto.race.options import RaceOptions

__all__ = ["RaceOptions", "RaceOutcome", "plan_automatically"]
