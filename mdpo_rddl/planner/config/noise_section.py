"""What the section `[Noise]` means where it leaves something out."""

from collections.abc import Mapping
from typing import Any

from mdpo_rddl.noise.units import ABSOLUTE

NOT_NUMBERS = ("unit", "paired")

# Sections without a unit are older than it: their numbers are absolute, and so is what they do
# not name.
_WITHOUT_UNIT: dict[str, dict[str, Any]] = {
    "AdaptiveNoise": {"sigma_max": 10.0, "unit": ABSOLUTE},
    "ConstantNoise": {"sigma": 1.0, "unit": ABSOLUTE},
}


def rule_values(section: Mapping[str, Any]) -> dict[str, Any]:
    """The section with a `method`, and with a unit where the rule has one and none is given."""
    values = {"method": "AdaptiveNoise", **section}
    if "unit" in values:
        return values
    return {**_WITHOUT_UNIT.get(str(values["method"]), {}), **values}
