"""What the section `[Noise]` means where it leaves something out."""

from collections.abc import Mapping
from typing import Any

from mdpo_rddl.noise.units import ABSOLUTE, UNITS

NOT_NUMBERS = ("unit", "paired")

# Sections without a unit are older than it: their numbers are absolute, and so is what they do
# not name. Those with `paired`, which these rules have only since there are units, are not.
_WITHOUT_UNIT: dict[str, dict[str, Any]] = {
    "AdaptiveNoise": {"sigma_max": 10.0, "unit": ABSOLUTE},
    "ConstantNoise": {"sigma": 1.0, "unit": ABSOLUTE},
}


def rule_values(section: Mapping[str, Any]) -> dict[str, Any]:
    """The section with a `method`, and with a unit where the rule has one and none is given."""
    values = {"method": "AdaptiveNoise", **section}
    if "unit" in values or "paired" in values:
        return values
    return {**_WITHOUT_UNIT.get(str(values["method"]), {}), **values}


def lacks_unit(section: Mapping[str, Any]) -> str | None:
    """The key of a scale whose unit would be a guess, in words with what it needs; None if none is.

    A file from before the units to which `paired` was added would change what its scale means.
    """
    values = rule_values(section)
    if "unit" in values or str(values["method"]) not in _WITHOUT_UNIT:
        return None
    units = " or ".join(f"unit={unit!r}" for unit in UNITS)
    scales = [key for key in values if key.startswith("sigma")]
    return f"{scales[0]}: beside paired it needs {units}" if scales else None
