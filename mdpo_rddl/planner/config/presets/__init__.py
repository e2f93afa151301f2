"""Named sets of defaults for the planner, chosen by measurement."""

from mdpo_rddl.planner.config.preset_names import DEFAULT_PRESET, PLAIN_PRESET
from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.config.presets.paper import paper_preset

PRESETS = {DEFAULT_PRESET: auto_preset, PLAIN_PRESET: paper_preset}

__all__ = ["DEFAULT_PRESET", "PLAIN_PRESET", "PRESETS"]
