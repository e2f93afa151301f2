"""Named sets of defaults for the planner, chosen by measurement."""

from mdpo_rddl.planner.config.presets.auto import auto_preset
from mdpo_rddl.planner.config.presets.paper import paper_preset

PRESETS = {"auto": auto_preset, "paper": paper_preset}
DEFAULT_PRESET = "auto"
# what options for one training with one policy start from
PLAIN_PRESET = "paper"

__all__ = ["DEFAULT_PRESET", "PLAIN_PRESET", "PRESETS"]
