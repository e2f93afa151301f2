"""Named sets of defaults for the planner, chosen by measurement."""

from mdpo_rddl.presets.paper import paper_preset

PRESETS = {"paper": paper_preset}
DEFAULT_PRESET = "paper"

__all__ = ["DEFAULT_PRESET", "PRESETS"]
